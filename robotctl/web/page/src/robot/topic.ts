// The newest message of one kind, and whether it is old.

import { signal } from "@preact/signals";

import type { Playback } from "../wire/messages";
import { clock } from "./clock";

export interface Stamped {
  readonly stamp_ns: number;
}

const STALE_PERIODS = 3;
const SHORTEST_PERIOD_MS = 100;
const LONGEST_PERIOD_MS = 2000;
const PERIOD_SMOOTHING = 0.2;

/** The time that is shown of a recording; null: the robot lives, or none has come yet. */
export const playback = signal<Playback | null>(null);

/** One kind of message. Its period is learnt from the stamps of those that come. */
export class Topic<T extends Stamped> {
  readonly newest = signal<T | null>(null);
  private periodMs = SHORTEST_PERIOD_MS;
  private receivedMs = -Infinity;

  take(message: T, nowMs: number): void {
    const before = this.newest.peek();
    if (before !== null) {
      const gap = (message.stamp_ns - before.stamp_ns) / 1e6;
      const bounded = Math.min(Math.max(gap, SHORTEST_PERIOD_MS), LONGEST_PERIOD_MS);
      this.periodMs += PERIOD_SMOOTHING * (bounded - this.periodMs);
    }
    this.receivedMs = nowMs;
    this.newest.value = message;
  }

  forget(): void {
    this.newest.value = null;
    this.receivedMs = -Infinity;
  }

  /** Age of the newest [ms], by the robot's clock where that is known, so that a late link shows; Infinity: none. */
  ageMs(nowMs: number): number {
    const message = this.newest.peek();
    if (message === null) return Infinity;
    const shown = playback.peek();
    if (shown !== null) return (shown.at_ns - message.stamp_ns) / 1e6;
    const sinceReceived = nowMs - this.receivedMs;
    const robotMs = clock.at(nowMs);
    return robotMs === null ? sinceReceived : Math.max(sinceReceived, robotMs - message.stamp_ns / 1e6);
  }

  isStale(nowMs: number): boolean {
    // A recording is shown in jumps, which say nothing of the period.
    const longestMs = playback.peek() === null ? STALE_PERIODS * this.periodMs : LONGEST_PERIOD_MS;
    return this.ageMs(nowMs) > longestMs;
  }
}
