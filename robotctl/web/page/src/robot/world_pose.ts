// The robot's pose in the world, by the policy of robotctl/messages/world_pose.py.

import { LocalisationStatus, type ControlState, type LocalisationState } from "../wire/messages";
import { compose, type Pose } from "./se2";

const IDENTITY: Pose = { x_m: 0, y_m: 0, theta_rad: 0 };

/** Keeps the last known place of `odom`; while the localiser searches, the odometry carries on from it. */
export class WorldPose {
  private hasLocaliser = false;
  private known: LocalisationState | null = null;

  reset(hasLocaliser: boolean): void {
    this.hasLocaliser = hasLocaliser;
    this.known = null;
  }

  localise(state: LocalisationState): void {
    this.hasLocaliser = true;
    if (this.known !== null && this.known.stamp_ns > state.stamp_ns) this.known = null; // a recording went back
    if (state.status === LocalisationStatus.LOCALISED) this.known = state;
  }

  /** `base` in `world`; null if that is unknown. */
  pose(control: ControlState): Pose | null {
    const T_world_odom = this.T_world_odom(control);
    return T_world_odom === null ? null : compose(T_world_odom, control);
  }

  private T_world_odom(control: ControlState): Pose | null {
    if (!this.hasLocaliser) return IDENTITY;
    return this.known?.odom_epoch_ns === control.odom_epoch_ns ? this.known : null;
  }

  /** What changes when the pose jumps. */
  epoch(control: ControlState): string {
    return `${control.odom_epoch_ns} ${this.known?.epoch_ns ?? 0}`;
  }
}
