// The emergency stop: always in reach, and honest about whether it would work.

import { useEffect } from "preact/hooks";

import { now } from "../robot/clock";
import { SafetyState } from "../wire/messages";
import { nameOf } from "../wire/names";
import { readiness, stop } from "../wire/stop_line";
import { outcome, type StopOutcome } from "../wire/stop_outcome";
import { words } from "../words";

const text = words.stop;
const SHOWN_MS = 8000;

export function Stop() {
  useEffect(listenToSpace, []);
  const ready = readiness.value;
  const last = outcome.value;
  return (
    <div class={ready.works ? "stop" : "stop stop-dead"}>
      <button type="button" onPointerDown={stop} onClick={onClick} title={text.describe} aria-describedby="stop-ready">
        <span class="stop-word">{text.button}</span>
        <span id="stop-ready" class="stop-ready">
          {ready.works ? text.works(ready.tripMs) : text.doesNot}
        </span>
      </button>
      {last !== null && !isPast(last) && (
        <p class={`stop-outcome stop-${last.kind}`} role="alert">
          {say(last)}
        </p>
      )}
    </div>
  );
}

/** Enter, and what assists people, click without a pointer; a pointer has stopped as it came down. */
function onClick(event: MouseEvent): void {
  if (event.detail === 0) stop();
}

/** The space bar stops, whatever has the focus: it presses no other button, and goes into no field. */
function listenToSpace(): () => void {
  const down = (event: KeyboardEvent) => {
    if (event.code !== "Space") return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) stop();
  };
  const up = (event: KeyboardEvent) => {
    if (event.code === "Space") event.preventDefault();
  };
  addEventListener("keydown", down, { capture: true });
  addEventListener("keyup", up, { capture: true });
  return () => {
    removeEventListener("keydown", down, { capture: true });
    removeEventListener("keyup", up, { capture: true });
  };
}

/** Whether an answer has been shown for long enough; what went wrong stays. */
function isPast(last: StopOutcome): boolean {
  return last.kind === "seen" && now.value - last.atMs > SHOWN_MS;
}

function say(last: StopOutcome): string {
  if (last.kind !== "seen") return text[last.kind];
  const state = nameOf(SafetyState, last.state);
  return text.seen(state === null ? String(last.state) : words.states[state], last.afterMs);
}
