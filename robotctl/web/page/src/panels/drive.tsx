// Arming, modes, and driving by sticks.

import {
  decision,
  interruption,
  isBlind,
  isDriver,
  mayDrive,
  setSpeed,
  speed,
} from "../driving/driving";
import { driver, hello, topics } from "../robot/robot";
import { ask, live } from "../wire/live";
import { Mode, SafetyState } from "../wire/messages";
import { words } from "../words";
import { Joysticks } from "./joystick";
import { PadPanel } from "./pad";

const text = words.drive;
const MODES = Object.keys(Mode) as (keyof typeof Mode)[];

export function Drive() {
  if (!mayDrive.value && hello.value !== null) return <p class="empty">{text.lookOnly}</p>;
  return (
    <div class="drive">
      <Arming />
      <Modes />
      <Wheel />
      {isDriver.value && <Sticks />}
      <p class="hint">{hello.value?.holonomic === true ? text.keys : text.keysPlain}</p>
      <PadPanel />
    </div>
  );
}

function Arming() {
  const state = topics.ControlState.newest.value?.state;
  const isPowered = state === SafetyState.ARMED || state === SafetyState.DRIVING;
  return (
    <div class="row">
      <button
        type="button"
        class="primary"
        disabled={isPowered || isBlind.value}
        onClick={() => ask(text.arm, { type: "ArmRequest", arm: true })}
      >
        {text.arm}
      </button>
      <button type="button" onClick={() => ask(text.disarm, { type: "ArmRequest", arm: false })}>
        {text.disarm}
      </button>
    </div>
  );
}

function Modes() {
  const mode = topics.NavigationState.newest.value?.mode;
  return (
    <div class="row modes" role="group" aria-label={text.modes}>
      {MODES.map((name) => (
        <button
          key={name}
          type="button"
          aria-pressed={mode === Mode[name]}
          title={words.modeHints[name]}
          onClick={() => ask(words.modes[name], { type: "ModeRequest", mode: Mode[name] })}
        >
          {words.modes[name]}
        </button>
      ))}
    </div>
  );
}

/** Who has the sticks, and how to get or give them. */
function Wheel() {
  const { client = null, name = "", asking = null, asking_name = "", why = "" } = driver.value ?? {};
  const own = hello.value?.client;
  const isOthers = client !== null && client !== own;
  return (
    <div class="wheel">
      <p role="status">
        {client === null ? text.nobody : isOthers ? text.drives(name) : text.youDrive}
        {client === null && why !== "" && ` (${why})`}
        {asking !== null && asking === own && ` ${text.asked}`}
      </p>
      {asking !== null && isDriver.value && <p role="alert">{text.asks(asking_name)}</p>}
      {isDriver.value ? (
        <button type="button" onClick={() => live.send({ type: "GiveDriving" })}>
          {asking === null ? text.give : text.giveTo(asking_name)}
        </button>
      ) : (
        <button type="button" class="primary" onClick={() => ask(text.take, { type: "TakeDriving" })}>
          {isOthers ? text.ask : text.take}
        </button>
      )}
    </div>
  );
}

function Sticks() {
  return (
    <>
      <DeadManState />
      <Joysticks />
      <label class="speed">
        {text.speed} {Math.round(100 * speed.value)} %
        <input
          type="range"
          min="0.1"
          max="1"
          step="0.1"
          value={speed.value}
          onInput={(event) => setSpeed(event.currentTarget.valueAsNumber)}
        />
      </label>
    </>
  );
}

/** Whether the robot follows the sticks now; if not, why, and what to do. */
function DeadManState() {
  const locked = driver.value?.locked ?? "";
  const why = interruption.value;
  const source = decision.value?.source ?? null;
  if (isBlind.value) return <p class="dead-man locked">{text.blind}</p>;
  if (source !== null && locked !== "") {
    return (
      <p class="dead-man locked" role="alert">
        {text.locked}: {locked}
      </p>
    );
  }
  if (why !== null) {
    return (
      <p class="dead-man locked" role="alert">
        {text.interruptions[why]} {text.fresh}
      </p>
    );
  }
  return (
    <p class={source === null ? "dead-man" : "dead-man held"} role="status">
      {source === null ? text.released : `${text.held}: ${text.sources[source]}`}
    </p>
  );
}
