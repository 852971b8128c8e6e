// Reads all input devices, decides, and sends the sticks while this page is the one that drives.

import { computed, effect, signal } from "@preact/signals";

import { keep, kept } from "../kept";
import { Mode } from "../wire/messages";
import { now } from "../robot/clock";
import { driver, hello, topics } from "../robot/robot";
import { ask, live, sendSticks } from "../wire/live";
import { stop } from "../wire/stop_line";
import { words } from "../words";
import { DeadMan, type Decision, type Interruption } from "./dead_man";
import { Keyboard } from "./keyboard";
import { Pad } from "./pad";
import type { ButtonAction } from "./pad_mapping";
import type { SourceName } from "./source";
import { Step } from "./step";
import { Touch } from "./touch";

const READ_MS = 25;
/** The sticks go out with every second reading: 20 times a second. */
const READINGS_A_SAMPLE = 2;
const SPEED_KEY = "speed";

export const touch = new Touch();
export const step = new Step();
/** Share of the sticks' full effect (0, 1]. */
export const speed = signal(kept(SPEED_KEY, 0.5));
export const decision = signal<Decision | null>(null);
export const interruption = signal<Interruption | null>(null);

export const isDriver = computed(() => {
  const client = hello.value?.client;
  return live.isOpen.value && client !== undefined && driver.value?.client === client;
});
export const mayDrive = computed(() => hello.value?.role === "drive");
/** Whether what is shown of the robot is old, so that nobody may drive by it. */
export const isBlind = computed(
  () => !live.isOpen.value || topics.ControlState.newest.value === null || topics.ControlState.isStale(now.value),
);

const keyboard = new Keyboard();
const deadMan = new DeadMan();
const pad = new Pad(press);

export function setSpeed(share: number): void {
  speed.value = share;
  keep(SPEED_KEY, share);
}

export function startDriving(): void {
  keyboard.listen();
  addEventListener("blur", () => letGo("blur"));
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) letGo("hidden");
  });
  effect(() => {
    void isDriver.value;
    letGo("driver"); // who gets the sticks says at once that nothing is held: the server waits for that
  });
  live.onClose = () => letGo("closed");
  let readings = 0;
  setInterval(() => {
    readings++;
    read(readings % READINGS_A_SAMPLE === 0);
  }, READ_MS);
}

/** Let go of everything, and say so at once. */
function letGo(why: Interruption): void {
  keyboard.letGo();
  touch.letGo();
  step.letGo();
  deadMan.interrupt(why);
  interruption.value = deadMan.interruption;
  decide(true);
}

function read(sends: boolean): void {
  if (document.hidden) return;
  if (topics.ControlState.isStale(performance.now())) deadMan.interrupt("stale");
  decide(sends);
}

function decide(sends: boolean): void {
  const nowMs = performance.now();
  const readings = new Map([
    ["touch", touch.read(nowMs)],
    ["step", step.read(nowMs)],
    ["keyboard", keyboard.read(nowMs)],
    ["pad", pad.read()],
  ] as const satisfies readonly (readonly [SourceName, unknown])[]);
  const decided = deadMan.step(readings, nowMs);
  const changed = decided.held !== decision.peek()?.held;
  decision.value = decided;
  interruption.value = deadMan.interruption;
  if (isDriver.peek() && (sends || changed)) send(decided);
}

function send(decided: Decision): void {
  const share = decided.source === "step" ? 1 : speed.peek();
  sendSticks(
    {
      sample: decided.sample,
      held: decided.held,
      forward: share * decided.forward,
      turn: share * decided.turn,
      sideways: share * decided.sideways,
    },
    decided.takenMs,
  );
}

function press(action: ButtonAction): void {
  switch (action) {
    case "stop":
      stop();
      break;
    case "arm":
    case "disarm":
      ask(words.drive[action], { type: "ArmRequest", arm: action === "arm" });
      break;
    case "hold":
      ask(words.modes.HOLD, { type: "ModeRequest", mode: Mode.HOLD });
      break;
    case "auto":
      ask(words.modes.AUTO, { type: "ModeRequest", mode: Mode.AUTO });
      break;
    case "deadMan":
      break;
  }
}
