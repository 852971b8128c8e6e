// The bar of a replay: play and pause, rate, and the time shown, to be moved by hand.

import { useEffect } from "preact/hooks";
import { signal } from "@preact/signals";

import { playback } from "../robot/robot";
import { SafetyState, type History } from "../wire/messages";
import { nameOf } from "../wire/names";
import { words } from "../words";
import { runs } from "./mode";
import { align, history, pause, play, seek } from "./playback";

const text = words.replay;
const RATES = [0.5, 1, 2, 5, 10, 50] as const;
const STEP_S = 0.1;
const KEYS_OF_CONTROLS = "button, select, input:not([type=range]), summary";

const rate = signal<number>(1);
/** Time under the hand [s]; null: nobody moves it. */
const held = signal<number | null>(null);

export function ReplayBar({ histories }: { readonly histories?: readonly (History | null)[] }) {
  useEffect(listenToSpace, []);
  const now = playback.value;
  const end_s = (now?.end_ns ?? 0) / 1e9;
  const at_s = held.value ?? (now?.at_ns ?? 0) / 1e9;
  return (
    <section class="replay" aria-label={text.name}>
      <button type="button" class="primary" onClick={toggle} disabled={now === null}>
        {now?.is_playing === true ? text.pause : text.play}
      </button>
      <label class="replay-rate">
        {text.rate}
        <select
          value={String(rate.value)}
          onChange={(event) => {
            rate.value = Number(event.currentTarget.value);
            if (playback.peek()?.is_playing === true) play(rate.value);
          }}
        >
          {RATES.map((each) => (
            <option key={each} value={String(each)}>
              {text.times(each)}
            </option>
          ))}
        </select>
      </label>
      <div class="replay-time">
        {(histories ?? [history.value]).map((each, i) => (
          <Stretches key={i} history={each} offset_s={(now?.offsets_ns[i] ?? 0) / 1e9} end_s={end_s} />
        ))}
        <input
          type="range"
          aria-label={text.time}
          aria-valuetext={text.clock(at_s)}
          min="0"
          max={Math.max(end_s, STEP_S)}
          step={STEP_S}
          value={at_s}
          onInput={(event) => {
            held.value = event.currentTarget.valueAsNumber;
            seek(held.value);
          }}
          onChange={() => {
            held.value = null;
          }}
        />
      </div>
      <output class="replay-clock">
        {text.clock(at_s)} / {text.clock(end_s)}
      </output>
      {runs > 1 && histories !== undefined && (
        <button
          type="button"
          aria-pressed={now?.by_driving === true}
          disabled={histories.some((each) => each === null || each.driving_ns === null)}
          onClick={() => align(playback.peek()?.by_driving !== true)}
        >
          {text.align}
        </button>
      )}
    </section>
  );
}

interface StretchesProps {
  readonly history: History | null;
  readonly offset_s: number;
  readonly end_s: number;
}

/** The robot's states over the time of the run: faults are high, driving is half, the rest low. */
function Stretches({ history: whole, offset_s, end_s }: StretchesProps) {
  const all = end_s > 0 ? (whole?.stretches ?? []) : [];
  const share = (ns: number) => (100 * (ns / 1e9 + offset_s)) / end_s;
  return (
    <svg class="replay-states" viewBox="0 0 100 8" preserveAspectRatio="none" aria-hidden="true">
      {all.map(({ begin_ns, state, reason }, i) => {
        const next = all[i + 1]?.begin_ns ?? whole?.end_ns ?? begin_ns;
        const name = nameOf(SafetyState, state);
        const isFault = name === "FAULT" || name === "EMERGENCY_STOP";
        const height = isFault ? 8 : name === "DRIVING" ? 5 : 2;
        const width = Math.max(share(next) - share(begin_ns), isFault ? 0.4 : 0);
        return (
          <rect
            key={begin_ns}
            class={`replay-state-${name ?? "none"}`}
            x={share(begin_ns)}
            y={8 - height}
            width={width}
            height={height}
          >
            <title>
              {name === null ? state : words.states[name]} {reason}
            </title>
          </rect>
        );
      })}
    </svg>
  );
}

function toggle(): void {
  if (playback.peek()?.is_playing === true) pause();
  else play(rate.peek());
}

/** The space bar plays and pauses, but where it presses or writes something. */
function listenToSpace(): () => void {
  const down = (event: KeyboardEvent) => {
    if (event.code !== "Space" || (event.target as Element).closest(KEYS_OF_CONTROLS) !== null) return;
    event.preventDefault();
    if (!event.repeat) toggle();
  };
  addEventListener("keydown", down);
  return () => removeEventListener("keydown", down);
}
