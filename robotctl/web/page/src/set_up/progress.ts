// What has happened since a step of the set-up began.

import type { ControlState } from "../wire/messages";

export class Progress {
  /** Turn by the gyro and by the wheels since the beginning, to the left [rad]; gyro null: there is none. */
  gyroRad: number | null = null;
  headingRad = 0;

  constructor(
    readonly base: ControlState,
    public newest: ControlState = base,
  ) {}

  take(control: ControlState): void {
    const before = this.newest;
    this.newest = control;
    const turn = control.theta_rad - before.theta_rad;
    this.headingRad += Math.atan2(Math.sin(turn), Math.cos(turn));
    if (control.imu !== null) {
      const seconds = (control.stamp_ns - before.stamp_ns) / 1e9;
      this.gyroRad = (this.gyroRad ?? 0) + control.imu.rate_rad_s[2] * seconds;
    }
  }

  /** Way of each wheel since the beginning [m]. */
  get movedM(): readonly number[] {
    return this.newest.wheel_distance_m.map((each, i) => each - (this.base.wheel_distance_m[i] ?? 0));
  }
}
