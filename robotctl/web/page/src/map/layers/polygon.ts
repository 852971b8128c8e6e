import type { Point } from "../../robot/se2";
import type { Scene } from "./layer";

const FILL_ALPHA = 0.18;

/** A polygon's sides, and its inside if it is filled. */
export function polygon({ context, pixel }: Scene, corners: readonly Point[], colour: string, isFilled: boolean): void {
  context.beginPath();
  for (const [x, y] of corners) context.lineTo(x, y);
  context.closePath();
  context.strokeStyle = colour;
  context.lineWidth = 2 * pixel;
  context.stroke();
  if (!isFilled) return;
  const alpha = context.globalAlpha;
  context.globalAlpha = FILL_ALPHA * alpha;
  context.fillStyle = colour;
  context.fill();
  context.globalAlpha = alpha;
}

/** Words beside a point of the world, upright. */
export function label({ context, view }: Scene, [x_m, y_m]: Point, text: string, colour: string): void {
  const [x, y] = view.toScreen(x_m, y_m);
  context.save();
  context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  context.font = "600 12px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillStyle = colour;
  context.fillText(text, x + 10, y - 12);
  context.restore();
}

/** Middle of some points. */
export function middle(points: readonly Point[]): Point {
  const sum = points.reduce<[number, number]>(([a, b], [x, y]) => [a + x, b + y], [0, 0]);
  return [sum[0] / points.length, sum[1] / points.length];
}
