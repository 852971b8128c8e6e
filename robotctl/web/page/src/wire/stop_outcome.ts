// What became of the last stop that was asked for on this page.

import { signal } from "@preact/signals";

import type { StopSeen } from "./messages";

export type StopOutcome =
  | { readonly kind: "sent" }
  | { readonly kind: "seen"; readonly state: number; readonly afterMs: number; readonly atMs: number }
  | { readonly kind: "unanswered" }
  | { readonly kind: "unsent" };

const ANSWER_MS = 600;

export const outcome = signal<StopOutcome | null>(null);

// No number is used again after a reload: an answer to an earlier page is none to this one.
let lastId = Date.now() % 1_000_000_000;
let askedMs = 0;

/** Begin another stop and return its number. */
export function beginStop(): number {
  askedMs = performance.now();
  outcome.value = { kind: "unsent" };
  return ++lastId;
}

/** Note that a stop went out; it counts as unanswered if nothing comes back in time. */
export function noteSent(id: number): void {
  if (id !== lastId) return;
  outcome.value = { kind: "sent" };
  setTimeout(() => {
    if (id === lastId && outcome.peek()?.kind === "sent") outcome.value = { kind: "unanswered" };
  }, ANSWER_MS);
}

/** Take the server's answer, from whichever connection the stop went over. */
export function takeAnswer(seen: StopSeen): void {
  if (seen.id !== lastId) return;
  const nowMs = performance.now();
  outcome.value =
    seen.state === null
      ? { kind: "unanswered" }
      : { kind: "seen", state: seen.state, afterMs: nowMs - askedMs, atMs: nowMs };
}

/** Whether a stop is still the newest that was asked for. */
export function isNewest(id: number): boolean {
  return id === lastId;
}
