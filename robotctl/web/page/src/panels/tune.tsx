// Parameters, live: gains, limits, guard, following of paths, and what else the robot has.

import { signal } from "@preact/signals";

import { isBlind, mayDrive } from "../driving/driving";
import { changed, lastChange, parameters, shown, undo, type Parameter } from "../robot/parameters";
import { hello } from "../robot/robot";
import { patchOf } from "../tune/patch";
import { ask, saved } from "../wire/live";
import { words } from "../words";
import { ParameterRow, set } from "./parameter_row";
import { SearchField } from "./search_field";
import { StepResponse } from "./step_response";

const text = words.tune;

const wanted = signal("");
const onlyChanged = signal(false);
const asksToSave = signal(false);
const open = signal<ReadonlySet<string>>(new Set());

export function Tune() {
  if (parameters.value.length === 0) return <p class="empty">{text.none}</p>;
  return (
    <div class="tune">
      {!mayDrive.value && <p class="hint">{text.lookOnly}</p>}
      <div class="finder">
        <SearchField label={text.find} placeholder={text.placeholder} wanted={wanted} />
      </div>
      <Actions />
      <StepResponse />
      <Groups />
    </div>
  );
}

function Actions() {
  const last = lastChange.value;
  const isLocked = !mayDrive.value || isBlind.value;
  const nothing = changed.value.length === 0;
  return (
    <>
      <div class="row">
        <button
          type="button"
          aria-pressed={onlyChanged.value}
          onClick={() => {
            onlyChanged.value = !onlyChanged.value;
          }}
        >
          {text.onlyChanged(changed.value.length)}
        </button>
        <button
          type="button"
          disabled={isLocked || last === null}
          onClick={() => {
            const back = undo();
            if (back !== null) set(back.name, back.value);
          }}
        >
          {last === null ? text.undo : text.undoThis(last.name, shown(last.from))}
        </button>
        <button
          type="button"
          disabled={isLocked || nothing}
          onClick={() => ask(text.reset, { type: "ResetRequest" })}
        >
          {text.reset}
        </button>
        <button type="button" disabled={nothing} onClick={download}>
          {text.download}
        </button>
        {hello.value?.file !== "" && (
          <button
            type="button"
            disabled={isLocked}
            onClick={() => {
              saved.value = null;
              asksToSave.value = true;
            }}
          >
            {text.save}
          </button>
        )}
      </div>
      {asksToSave.value && <ConfirmSave />}
      {!nothing && <pre class="patch">{patchOf(changed.value)}</pre>}
      {saved.value !== null && (
        <p role="status">{text.saved(saved.value.file, saved.value.copy, saved.value.keys.length)}</p>
      )}
    </>
  );
}

function ConfirmSave() {
  const close = () => {
    asksToSave.value = false;
  };
  return (
    <div class="confirm" role="alertdialog" aria-label={text.save}>
      <p>{text.confirmSave(changed.value.length, hello.value?.file ?? "")}</p>
      <div class="row">
        <button
          type="button"
          class="primary"
          onClick={() => {
            close();
            ask(text.save, { type: "SaveRequest" });
          }}
        >
          {text.write}
        </button>
        <button type="button" onClick={close}>
          {text.cancel}
        </button>
      </div>
    </div>
  );
}

function Groups() {
  const part = wanted.value.toLowerCase();
  const found = parameters.value.filter(
    (each) => matches(each, part) && (!onlyChanged.value || each.wanted !== each.standard),
  );
  if (found.length === 0) return <p class="empty">{text.noMatch}</p>;
  const groups = new Map<string, Parameter[]>();
  for (const each of found) {
    const table = each.key.slice(0, each.key.lastIndexOf("."));
    groups.set(table, [...(groups.get(table) ?? []), each]);
  }
  const isNarrow = part !== "" || onlyChanged.value;
  return (
    <div class="groups">
      {[...groups].map(([table, members]) => (
        <details key={table} open={isNarrow || open.value.has(table)}>
          <summary
            onClick={(event) => {
              event.preventDefault();
              const next = new Set(open.value);
              if (!next.delete(table)) next.add(table);
              open.value = next;
            }}
          >
            {text.group(table, members.length, members.filter((each) => each.wanted !== each.standard).length)}
          </summary>
          <ul>
            {members.map((each) => (
              <ParameterRow key={each.name} parameter={each} />
            ))}
          </ul>
        </details>
      ))}
    </div>
  );
}

function matches({ name, key, description }: Parameter, part: string): boolean {
  return [name, key, description].some((each) => each.toLowerCase().includes(part));
}

function download(): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([patchOf(changed.peek())], { type: "application/toml" }));
  link.download = `${hello.peek()?.name ?? "robot"}.patch.toml`;
  link.click();
  URL.revokeObjectURL(link.href);
}
