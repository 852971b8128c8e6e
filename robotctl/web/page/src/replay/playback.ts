// The time that is shown of a recording, and what happened until then.

import { computed, effect, signal } from "@preact/signals";

import { live } from "../wire/live";
import { decode, doubles, floats } from "../wire/msgpack";
import { SafetyState, type History, type Notice } from "../wire/messages";
import { hello, notices, playback } from "../robot/robot";
import type { Point } from "../robot/se2";
import { nameOf } from "../wire/names";
import { words } from "../words";
import { isFrame, query } from "./mode";

const MOST_NOTICES = 500;
const CRITICAL = 2;
const RETRY_MS = 1000;

interface Path {
  readonly times_s: Float64Array;
  readonly points: Float32Array;
  readonly begins: Uint8Array;
}

export const history = signal<History | null>(null);
const path = computed<Path | null>(() => {
  const whole = history.value;
  if (whole === null) return null;
  return { times_s: doubles(whole.times_s), points: floats(whole.points), begins: whole.begins };
});
/** What people were told, and faults, of the whole run. */
const told = computed(() => {
  const { notices = [], stretches = [] } = history.value ?? {};
  const faults = stretches
    .filter(({ state }) => state === SafetyState.FAULT || state === SafetyState.EMERGENCY_STOP)
    .map(({ begin_ns, state, reason }): Notice => {
      const name = nameOf(SafetyState, state);
      const text = `${name === null ? state : words.states[name]}: ${reason}`;
      return { type: "Notice", stamp_ns: begin_ns, severity: CRITICAL, text };
    });
  return [...notices, ...faults].sort((a, b) => a.stamp_ns - b.stamp_ns);
});

export function startPlayback(): void {
  let run = "";
  effect(() => {
    const replay = hello.value?.replay ?? null;
    const name = replay === null ? "" : `${replay.name} ${replay.begin_ns}`;
    if (isFrame || name === run) return;
    run = name;
    void fetchHistory();
  });
  let shown = -1;
  effect(() => {
    const all = told.value;
    const at = playback.value?.at_ns ?? -1;
    const count = firstAfter(all.length, (i) => (all[i] as Notice).stamp_ns > at);
    const key = history.value === null ? -1 : count;
    if (key === shown) return;
    shown = key;
    notices.value = all.slice(Math.max(0, count - MOST_NOTICES), count);
  });
}

async function fetchHistory(): Promise<void> {
  for (;;) {
    try {
      const answer = await fetch(`/history${query}`);
      if (!answer.ok) return;
      history.value = decode(new Uint8Array(await answer.arrayBuffer())) as History;
      return;
    } catch {
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
    }
  }
}

/** Stretches of the path driven until the time shown. */
export function drivenPath(): Point[][] {
  const whole = path.peek();
  const at_s = (playback.peek()?.at_ns ?? 0) / 1e9;
  if (whole === null) return [];
  const { times_s, points, begins } = whole;
  const stretches: Point[][] = [];
  for (let i = 0; i < times_s.length && (times_s[i] as number) <= at_s; i++) {
    if (begins[i] !== 0) stretches.push([]);
    stretches.at(-1)?.push([points[2 * i] as number, points[2 * i + 1] as number]);
  }
  return stretches;
}

export function seek(seconds: number): void {
  live.send({ type: "Seek", at_ns: Math.max(0, Math.round(seconds * 1e9)) });
}

export function play(rate: number): void {
  live.send({ type: "Play", rate });
}

export function pause(): void {
  live.send({ type: "Pause" });
}

export function align(by_driving: boolean): void {
  live.send({ type: "Align", by_driving });
}

/** The first of `count` numbers for which something holds that holds for all later ones. */
function firstAfter(count: number, holds: (i: number) => boolean): number {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(middle)) high = middle;
    else low = middle + 1;
  }
  return low;
}
