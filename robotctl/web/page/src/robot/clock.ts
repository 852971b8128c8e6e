// The clocks of the page: the robot's, and a tick for what shows ages.

import { signal } from "@preact/signals";

import { RobotClock } from "../wire/clock";

const TICK_MS = 200;

export const clock = new RobotClock();

/** Page's time [ms], a few times a second. */
export const now = signal(performance.now());

export function startTicking(): void {
  setInterval(() => {
    now.value = performance.now();
  }, TICK_MS);
}
