// The path that the robot has driven while this page looked on.

import type { Point, Pose } from "./se2";

const STEP_M = 0.02;
const MOST_POINTS = 20_000;

/** Stretches of the path; a new one begins where the pose jumps. */
export class Trail {
  stretches: Point[][] = [];
  private epoch = "";
  private count = 0;

  add(pose: Pose, epoch: string): void {
    let stretch = this.stretches.at(-1);
    if (stretch === undefined || epoch !== this.epoch) {
      this.epoch = epoch;
      stretch = [];
      this.stretches.push(stretch);
    }
    const last = stretch.at(-1);
    if (last !== undefined && Math.hypot(pose.x_m - last[0], pose.y_m - last[1]) < STEP_M) return;
    stretch.push([pose.x_m, pose.y_m]);
    if (++this.count > MOST_POINTS) this.thin();
  }

  clear(): void {
    this.stretches = [];
    this.count = 0;
  }

  /** Keep every second point: a long path stays whole, only coarser. */
  private thin(): void {
    this.stretches = this.stretches.map((stretch) => stretch.filter((_, i) => i % 2 === 0));
    this.count = this.stretches.reduce((sum, stretch) => sum + stretch.length, 0);
  }
}
