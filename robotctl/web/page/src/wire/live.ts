// The line on which pictures and states come, and commands go.

import { signal } from "@preact/signals";

import { query } from "../replay/mode";
import { clock } from "../robot/clock";
import { take } from "../robot/robot";
import { checkAccess } from "./access";
import { ProvenClock } from "./clock";
import { Line, roundTripMs, type Tagged } from "./line";
import type { Received, Refused, Response, Saved, Sent, Sticks } from "./messages";
import { takeAnswer } from "./stop_outcome";

export interface Refusal {
  readonly what: string;
  readonly reason: string;
}

/** Time to the server and back [ms]; null until a pong came over this connection. */
export const tripMs = signal<number | null>(null);
/** The newest request that came to nothing; null: none did, or it was put away. */
export const refusal = signal<Refusal | null>(null);

/** What was last written into the robot's file for this page. */
export const saved = signal<Saved | null>(null);
/** What the wheels did, as this page asked for it last. */
export const response = signal<Response | null>(null);

const MOST_ASKED = 50;

const serverClock = new ProvenClock();
const asked = new Map<number, string>();
let lastId = 0;

export const live = new Line(`/live${query}`, (message: Tagged) => {
  const received = message as Received;
  if (received.type === "Pong") {
    clock.take(received, performance.now());
    serverClock.take(received, performance.now());
    tripMs.value = roundTripMs(received);
  } else if (received.type === "Refused") {
    refuse(received);
  } else if (received.type === "StopSeen") {
    takeAnswer(received);
  } else if (received.type === "Saved") {
    saved.value = received;
  } else if (received.type === "Response") {
    response.value = received;
  } else {
    take(received);
  }
});

export function startLive(): void {
  live.onRefused = () => void checkAccess();
  live.isOpen.subscribe((isOpen) => {
    if (!isOpen) forgetClocks();
  });
  live.start();
}

/** The next connection may be to a server, or a robot, that began anew. */
function forgetClocks(): void {
  clock.reset();
  serverClock.reset();
  tripMs.value = null;
}

type Timed = Extract<Sent, { at_ms: number; id: number }>;
type Body<T> = T extends Timed ? Omit<T, "id" | "at_ms"> : never;

/** Ask for something that the user wants now; `what` it is, in words, if it has to be said that it failed. */
export function ask(what: string, body: Body<Timed>): void {
  refusal.value = null;
  const stamp = stampRequest(what);
  if (stamp !== null && !live.send({ ...body, ...stamp } as Timed)) refusal.value = { what, reason: "" };
}

/** Number and time of a request of now, by whatever way it goes; null: there is no connection, which is said. */
export function stampRequest(what: string): { readonly id: number; readonly at_ms: number } | null {
  const at_ms = serverClock.at(performance.now());
  if (at_ms === null) {
    refusal.value = { what, reason: "" };
    return null;
  }
  const id = ++lastId;
  asked.set(id, what);
  if (asked.size > MOST_ASKED) asked.delete(id - MOST_ASKED);
  return { id, at_ms };
}

/** Send a sample of the sticks that was taken at a time of the page; lost if the line is not ready. */
export function sendSticks(sample: Omit<Sticks, "type" | "at_ms">, takenMs: number): void {
  const at_ms = serverClock.at(takenMs);
  if (at_ms !== null) live.send({ type: "Sticks", at_ms, ...sample });
}

function refuse(message: Refused): void {
  refusal.value = { what: asked.get(message.id) ?? "", reason: message.reason };
}
