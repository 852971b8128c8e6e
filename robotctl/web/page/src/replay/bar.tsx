// The bar of a replay: play and pause, rate, and the time shown, to be moved by hand.

import { signal, useSignalEffect } from "@preact/signals";

import { playback } from "../robot/robot";
import { SafetyState, type History } from "../wire/messages";
import { nameOf } from "../wire/names";
import { words } from "../words";
import { isFramed, runs } from "./mode";
import { align, history, pause, play, seek } from "./playback";

const text = words.replay;
const RATES = [0.5, 1, 2, 5, 10, 50] as const;
const STEP_S = 0.1;
/** Time after which what is shown counts, though it is not what was asked for: it plays on [ms]. */
const PATIENCE_MS = 250;
const KEYS_OF_CONTROLS = "button, select, input:not([type=range]), summary";

const rate = signal<number>(1);
/** Time that was asked for and is not shown yet [s], and when [ms]; null: the time shown counts. */
const asked = signal<{ readonly at_s: number; readonly sinceMs: number } | null>(null);

export function ReplayBar({ histories }: { readonly histories?: readonly (History | null)[] }) {
  useSignalEffect(settle);
  const now = playback.value;
  const end_s = (now?.end_ns ?? 0) / 1e9;
  const at_s = asked.value?.at_s ?? (now?.at_ns ?? 0) / 1e9;
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
          max={STEP_S * Math.max(Math.ceil(end_s / STEP_S), 1)}
          step={STEP_S}
          value={at_s}
          onInput={(event) => {
            const at_s = event.currentTarget.valueAsNumber;
            asked.value = { at_s, sinceMs: performance.now() };
            seek(at_s);
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

/** Forget what was asked for once it is shown. */
function settle(): void {
  const now = playback.value;
  const last = asked.peek();
  if (now === null || last === null) return;
  const isShown = Math.abs(now.at_ns / 1e9 - last.at_s) <= STEP_S;
  if (isShown || performance.now() - last.sinceMs > PATIENCE_MS) asked.value = null;
}

function toggle(): void {
  if (playback.peek()?.is_playing === true) pause();
  else play(isFramed ? (playback.peek()?.rate ?? 1) : rate.peek());
}

/** Let the space bar play and pause, but where it presses or writes something; also in a page that has no bar. */
export function listenToSpace(): void {
  addEventListener("keydown", (event) => {
    if (event.code !== "Space" || (event.target as Element).closest(KEYS_OF_CONTROLS) !== null) return;
    event.preventDefault();
    if (!event.repeat) toggle();
  });
}
