// A map of cells as a picture, made once for each message.

import type { LiveMap } from "../../wire/messages";
import type { Scene } from "./layer";

const UNKNOWN = -1;

/** Red, green, blue and alpha of a cell with a value of 0 to 100, or -1: unknown. */
export type Shade = (value: number) => readonly [number, number, number, number];

export class GridImage {
  private map: LiveMap | null = null;
  private key = "";
  private image: HTMLCanvasElement | null = null;

  /** Draw a map; `key` names the shade, which makes the picture anew when it changes. */
  draw({ context }: Scene, map: LiveMap, key: string, shade: Shade): void {
    if (map.rows === 0 || map.columns === 0) return;
    if (map !== this.map || key !== this.key || this.image === null) {
      this.image = paint(map, shade);
      this.map = map;
      this.key = key;
    }
    context.save();
    context.translate(map.x_m, map.y_m);
    context.rotate(map.theta_rad);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.image, 0, 0, map.columns * map.resolution_m, map.rows * map.resolution_m);
    context.restore();
  }
}

function paint(map: LiveMap, shade: Shade): HTMLCanvasElement {
  const image = document.createElement("canvas");
  image.width = map.columns;
  image.height = map.rows;
  const context = image.getContext("2d") as CanvasRenderingContext2D;
  const pixels = context.createImageData(map.columns, map.rows);
  const words = new Uint32Array(pixels.data.buffer);
  const shades = new Uint32Array(256);
  for (let value = UNKNOWN; value <= 100; value++) {
    const [red, green, blue, alpha] = shade(value);
    shades[value & 0xff] = (alpha << 24) | (blue << 16) | (green << 8) | red;
  }
  map.cells.forEach((cell, i) => {
    words[i] = shades[cell] as number;
  });
  context.putImageData(pixels, 0, 0);
  return image;
}

/** Red, green and blue of a colour `#rrggbb`. */
export function rgb(colour: string): readonly [number, number, number] {
  const number = Number.parseInt(colour.slice(1), 16);
  return [(number >> 16) & 0xff, (number >> 8) & 0xff, number & 0xff];
}

/** Shades between free and occupied; what is unknown shows the ground. */
export function occupancy(free: string, wall: string): Shade {
  const from = rgb(free);
  const to = rgb(wall);
  return (value) => {
    if (value < 0) return [0, 0, 0, 0];
    const share = value / 100;
    const mix = (i: 0 | 1 | 2) => Math.round(from[i] + share * (to[i] - from[i]));
    return [mix(0), mix(1), mix(2), 255];
  };
}
