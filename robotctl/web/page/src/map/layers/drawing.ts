// What several layers draw alike.

import type { Point, Pose } from "../../robot/se2";
import { floats } from "../../wire/msgpack";
import type { Scene } from "./layer";

/** Squares of so many pixels around points. */
export function dots({ context, pixel }: Scene, points: Iterable<Point>, colour: string, size = 3): void {
  context.fillStyle = colour;
  const side = size * pixel;
  for (const [x, y] of points) context.fillRect(x - side / 2, y - side / 2, side, side);
}

/** A line through points. */
export function line({ context, pixel }: Scene, points: Iterable<Point>, colour: string, width = 2): void {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.strokeStyle = colour;
  context.lineWidth = width * pixel;
  context.lineJoin = "round";
  context.stroke();
}

/** A ring around a point, with a radius in metres. */
export function ring({ context, pixel }: Scene, x: number, y: number, radius: number, colour: string): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = 2 * pixel;
  context.stroke();
}

/** A pin that points where a heading leads, of a size in pixels. */
export function arrow({ context, pixel }: Scene, pose: Pose, colour: string, size = 26): void {
  context.save();
  context.translate(pose.x_m, pose.y_m);
  context.rotate(pose.theta_rad);
  context.scale(size * pixel, size * pixel);
  context.beginPath();
  context.moveTo(1, 0);
  context.lineTo(-0.35, 0.45);
  context.lineTo(-0.1, 0);
  context.lineTo(-0.35, -0.45);
  context.closePath();
  context.fillStyle = colour;
  context.fill();
  context.restore();
}

/** Points of packed float32: the first two of each group of so many. */
export function* pointsOf(packed: Uint8Array, stride: number): Generator<Point> {
  const values = floats(packed);
  for (let i = 0; i + 1 < values.length; i += stride) yield [values[i] ?? 0, values[i + 1] ?? 0];
}
