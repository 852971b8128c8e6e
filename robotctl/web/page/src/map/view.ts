// Which part of the world the map shows: its middle [m], and how large a metre is [px].

import type { Point } from "../robot/se2";

const SMALLEST = 2;
const LARGEST = 2000;

export class View {
  x_m = 0;
  y_m = 0;
  /** Pixels of the page for a metre. */
  scale = 60;
  /** Size of the canvas, in pixels of the page. */
  width = 1;
  height = 1;
  /** Whether somebody has moved or zoomed it. */
  isChosen = false;

  toWorld(x: number, y: number): Point {
    return [this.x_m + (x - this.width / 2) / this.scale, this.y_m - (y - this.height / 2) / this.scale];
  }

  toScreen(x_m: number, y_m: number): Point {
    return [this.width / 2 + (x_m - this.x_m) * this.scale, this.height / 2 - (y_m - this.y_m) * this.scale];
  }

  pan(dx: number, dy: number): void {
    this.isChosen = true;
    this.x_m -= dx / this.scale;
    this.y_m += dy / this.scale;
  }

  /** Zoom by a factor, so that what is at a point of the screen stays there. */
  zoom(factor: number, x = this.width / 2, y = this.height / 2): void {
    this.isChosen = true;
    const [x_m, y_m] = this.toWorld(x, y);
    this.scale = Math.min(Math.max(this.scale * factor, SMALLEST), LARGEST);
    const [newX, newY] = this.toWorld(x, y);
    this.x_m += x_m - newX;
    this.y_m += y_m - newY;
  }

  /** Show a rectangle of the world, with a margin around. */
  fit(left_m: number, bottom_m: number, right_m: number, top_m: number): void {
    this.x_m = (left_m + right_m) / 2;
    this.y_m = (bottom_m + top_m) / 2;
    const wanted = Math.min(this.width / (right_m - left_m), this.height / (top_m - bottom_m));
    this.scale = Math.min(Math.max(0.94 * wanted, SMALLEST), LARGEST);
  }

  /** Let a context draw in metres of the world. */
  apply(context: CanvasRenderingContext2D, ratio: number): void {
    const k = this.scale * ratio;
    context.setTransform(
      k,
      0,
      0,
      -k,
      ratio * (this.width / 2 - this.x_m * this.scale),
      ratio * (this.height / 2 + this.y_m * this.scale),
    );
  }
}
