// Rigid motions of the plane, as robotctl/model/geometry/se2.py has them.

export interface Pose {
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
}

export type Point = readonly [x_m: number, y_m: number];

/** T_a_c of T_a_b and T_b_c. */
export function compose(a: Pose, b: Pose): Pose {
  const [x_m, y_m] = apply(a, b.x_m, b.y_m);
  return { x_m, y_m, theta_rad: wrap(a.theta_rad + b.theta_rad) };
}

/** A point of the frame on the right, in that on the left [m]. */
export function apply(pose: Pose, x: number, y: number): Point {
  const c = Math.cos(pose.theta_rad);
  const s = Math.sin(pose.theta_rad);
  return [pose.x_m + c * x - s * y, pose.y_m + s * x + c * y];
}

/** An angle within (-pi, pi]. */
export function wrap(angle: number): number {
  return angle - 2 * Math.PI * Math.ceil((angle - Math.PI) / (2 * Math.PI));
}
