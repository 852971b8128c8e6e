import { hello } from "../../robot/robot";
import type { Pose } from "../../robot/se2";
import type { Scene } from "./layer";

/** Trace and stroke the robot's body, in one of its states, at a pose; the path stays, to be filled. */
export function outline(
  { context, pixel }: Scene,
  pose: Pose,
  state: number,
  colour: string,
): void {
  context.save();
  context.translate(pose.x_m, pose.y_m);
  context.rotate(pose.theta_rad);
  context.beginPath();
  // A recording without the robot's file knows its body in one state only.
  const bodies = hello.peek()?.bodies ?? [];
  for (const corners of bodies[state] ?? bodies[0] ?? []) {
    corners.forEach(([x, y], i) => (i === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.closePath();
  }
  context.restore();
  context.strokeStyle = colour;
  context.lineWidth = 2 * pixel;
  context.stroke();
}
