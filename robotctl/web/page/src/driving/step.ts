// Driving by a step: straight ahead for a while, as long as its button is held.

import { RELEASED, type Reading } from "./source";

/** Duration of a step [s]. */
export const STEP_S = 2;

/** It ends by itself after this time, whoever forgot it [s]. */
const LONGEST_S = STEP_S + 0.3;

export class Step {
  private forward = 0;
  private beganMs: number | null = null;

  /** Begin with a share of the greatest speed. */
  begin(forward: number): void {
    this.forward = forward;
    this.beganMs = performance.now();
  }

  get isHeld(): boolean {
    return this.beganMs !== null;
  }

  letGo(): void {
    this.beganMs = null;
  }

  read(nowMs: number): Reading {
    if (this.beganMs !== null && nowMs - this.beganMs > 1000 * LONGEST_S) this.letGo();
    const held = this.beganMs !== null;
    return { ...RELEASED, held, sampledMs: nowMs, forward: held ? this.forward : 0 };
  }
}
