// The emergency stop: a connection of its own, so that nothing else is ever ahead of it.

import { computed, signal } from "@preact/signals";

import { now } from "../robot/clock";
import { Line, roundTripMs, type Tagged } from "./line";
import { live } from "./live";
import type { Pong, StopSeen } from "./messages";
import { beginStop, isNewest, noteSent, takeAnswer } from "./stop_outcome";

const FRESH_MS = 1500;
const RETRY_MS = 50;
const GIVE_UP_MS = 10_000;

const heartbeat = signal({ heardMs: -Infinity, tripMs: 0 });

const line = new Line("/stop", (message: Tagged) => {
  const received = message as Pong | StopSeen;
  if (received.type === "Pong") heartbeat.value = { heardMs: performance.now(), tripMs: roundTripMs(received) };
  else takeAnswer(received);
});

export type Readiness =
  | { readonly works: true; readonly tripMs: number }
  | { readonly works: false };

/** Whether a stop would get through now, by the heartbeat of its connection, and how soon [ms]. */
export const readiness = computed<Readiness>(() => {
  const { heardMs, tripMs } = heartbeat.value;
  return line.isOpen.value && now.value - heardMs < FRESH_MS ? { works: true, tripMs } : { works: false };
});

/**
 * Stop the robot, over the other connection where this one does not take it.
 *
 * A stop is the one request that is tried again when the line is back: late is better than never.
 */
export function stop(): void {
  const id = beginStop();
  trySending(id, performance.now() + GIVE_UP_MS);
}

function trySending(id: number, endMs: number): void {
  if (!isNewest(id)) return;
  const sent =
    line.send({ type: "Stop", id }) ||
    live.send({ type: "StopRequest", id });
  if (sent) noteSent(id);
  else if (performance.now() < endMs) setTimeout(() => trySending(id, endMs), RETRY_MS);
}

export function startStopLine(): void {
  line.start();
}
