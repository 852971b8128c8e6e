import type { Point, Pose } from "../../robot/se2";
import type { Scene } from "./layer";

/** Trace and stroke the polygons of the robot's body at a pose; the path stays, to be filled. */
export function outline(
  { context, pixel }: Scene,
  pose: Pose,
  polygons: readonly (readonly Point[])[],
  colour: string,
): void {
  context.save();
  context.translate(pose.x_m, pose.y_m);
  context.rotate(pose.theta_rad);
  context.beginPath();
  for (const corners of polygons) {
    corners.forEach(([x, y], i) => (i === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.closePath();
  }
  context.restore();
  context.strokeStyle = colour;
  context.lineWidth = 2 * pixel;
  context.stroke();
}
