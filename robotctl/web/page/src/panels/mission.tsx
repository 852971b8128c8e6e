// The robot's mission: how it gets on, and how it is changed.

import { mayDrive } from "../driving/driving";
import { tool } from "../map/tools";
import { canUndo, change, chosen, edit, edited, present, stopEditing, undo, upload } from "../plans/editor";
import { toml, type Mission as Plan } from "../plans/mission";
import { readToml, sentMission } from "../plans/send";
import { topics } from "../robot/robot";
import { ask } from "../wire/live";
import { Mode } from "../wire/messages";
import { words } from "../words";
import { ItemForm, nameOfItem, NewItems } from "./mission_items";

const text = words.mission;

export function Mission() {
  return (
    <div class="mission">
      {edited.value === null ? <Present /> : <Editor mission={edited.value} />}
    </div>
  );
}

function Present() {
  const state = topics.NavigationState.newest.value;
  const mission = present.value;
  const isAuto = state?.mode === Mode.AUTO;
  return (
    <>
      <p role="status">{state === null || mission === null ? text.none : text.state(mission.name, stateOf(state))}</p>
      {mission !== null && mayDrive.value && (
        <div class="row">
          <button type="button" class="primary" disabled={isAuto} onClick={() => ask(text.start, { type: "ModeRequest", mode: Mode.AUTO })}>
            {state !== null && state.item > 0 && !state.mission_completed ? text.resume : text.start}
          </button>
          <button type="button" onClick={() => ask(text.hold, { type: "ModeRequest", mode: Mode.HOLD })}>
            {text.hold}
          </button>
          <button type="button" disabled={state?.waits !== true} onClick={() => ask(text.goOn, { type: "GoOn" })}>
            {text.goOn}
          </button>
          <button type="button" onClick={() => ask(text.abort, { type: "Abort" })}>
            {text.abort}
          </button>
        </div>
      )}
      {mission !== null && state !== null && <Items mission={mission} item={state.item} />}
      {state !== null && state.trouble !== "" && <p class="hint">{state.trouble}</p>}
      {mayDrive.value && (
        <div class="row">
          <button type="button" onClick={() => draw(null)}>
            {text.draw}
          </button>
          {mission !== null && (
            <button type="button" onClick={() => draw(mission)}>
              {text.edit}
            </button>
          )}
          <Open />
          {mission !== null && <Save file={mission.name} content={() => topics.MissionView.newest.peek()?.content ?? ""} />}
        </div>
      )}
    </>
  );
}

function stateOf(state: { mission_completed: boolean; mission_failed: boolean; mode: number; waits: boolean }): string {
  if (state.mission_completed) return text.states.completed;
  if (state.mission_failed) return text.states.failed;
  if (state.mode !== Mode.AUTO) return text.states.paused;
  return state.waits ? text.states.waits : text.states.underWay;
}

function Items({ mission, item }: { mission: Plan; item: number }) {
  return (
    <ol class="items">
      {mission.item.map((each, i) => (
        <li key={i} class={i < item ? "done" : i === item ? "present" : ""} aria-current={i === item ? "step" : undefined}>
          <span>{nameOfItem(each, i)}</span>
          {mayDrive.value && (
            <button type="button" aria-label={text.jumpTo(i + 1)} onClick={() => ask(text.jump, { type: "JumpTo", item: i + 1 })}>
              {text.jump}
            </button>
          )}
        </li>
      ))}
    </ol>
  );
}

function draw(mission: Plan | null): void {
  edit(mission);
  sentMission.value = null;
  tool.value = "point";
}

function Editor({ mission }: { mission: Plan }) {
  const crc = sentMission.value?.crc;
  const hasIt = crc !== undefined && topics.MissionView.newest.value?.crc === crc;
  return (
    <>
      <label>
        {text.missionName}
        <input value={mission.name} onChange={(event) => change({ name: event.currentTarget.value })} />
      </label>
      <div class="row">
        <button type="button" aria-pressed={tool.value === "point"} onClick={() => (tool.value = tool.value === "point" ? "look" : "point")}>
          {text.points}
        </button>
        <button type="button" disabled={!canUndo.value} onClick={undo}>
          {text.undo}
        </button>
        <NewItems />
      </div>
      <ol class="items">
        {mission.item.map((item, i) => (
          <li key={i} class={i === chosen.value ? "present" : ""}>
            <button type="button" aria-expanded={i === chosen.value} onClick={() => (chosen.value = i === chosen.value ? null : i)}>
              {nameOfItem(item, i)}
            </button>
            {i === chosen.value && <ItemForm item={item} number={i} count={mission.item.length} />}
          </li>
        ))}
      </ol>
      {mission.item.length === 0 && <p class="empty">{text.empty}</p>}
      <p role="status">{crc === undefined ? "" : hasIt ? text.taken : text.sent}</p>
      <div class="row">
        <button type="button" class="primary" disabled={mission.item.length === 0} onClick={() => void upload()}>
          {text.upload}
        </button>
        <Save file={mission.name} content={() => toml(mission)} />
        <Open />
        <button
          type="button"
          onClick={() => {
            stopEditing();
            tool.value = "look";
          }}
        >
          {text.close}
        </button>
      </div>
    </>
  );
}

function Open() {
  return (
    <label class="file">
      {text.open}
      <input
        type="file"
        accept=".toml"
        onChange={(event) => {
          const file = event.currentTarget.files?.[0];
          if (file === undefined) return;
          void readToml<Plan>(text.open, file).then((mission) => {
            if (mission !== null) draw({ ...mission, name: mission.name ?? "", item: mission.item ?? [] });
          });
          event.currentTarget.value = "";
        }}
      />
    </label>
  );
}

function Save({ file, content }: { file: string; content: () => string | Uint8Array }) {
  return (
    <button
      type="button"
      onClick={() => {
        const link = document.createElement("a");
        link.href = URL.createObjectURL(new Blob([content() as BlobPart], { type: "application/toml" }));
        link.download = `${file || "mission"}.toml`;
        link.click();
        URL.revokeObjectURL(link.href);
      }}
    >
      {text.save}
    </button>
  );
}
