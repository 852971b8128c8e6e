// Draws the map, as soon as there is something new.

import { pose, topics } from "../robot/robot";
import type { LiveMap } from "../wire/messages";
import { arrow, dots, ring } from "./layers/drawing";
import type { Scene } from "./layers/layer";
import { LAYERS } from "./layers/registry";
import { readPalette, type Palette } from "./palette";
import { draft, draftPose, follows, shown, view } from "./tools";

/** Pause behind a message in which another may come, which is then drawn together with it [ms]. */
const PAUSE_MS = 1;
/** Longest time that a drawing waits for more [ms]. */
const PATIENCE_MS = 8;
const DRAFT_PX = 12;
const FIRST_SIZE_M = 8;

export class Painter {
  private readonly context: CanvasRenderingContext2D;
  private palette: Palette = readPalette();
  /** The drawing that is due, and when it was first asked for; null: none is. */
  private due: { readonly timer: number; readonly sinceMs: number } | null = null;
  private isMeasured = false;
  /** What the first view showed; nothing so far. */
  private firstShown: "nothing" | "robot" | "map" = "nothing";

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d") as CanvasRenderingContext2D;
  }

  /** Take new colours, and draw with them. */
  recolour(): void {
    this.palette = readPalette();
    this.request();
  }

  /** Take the canvas's size on the page. */
  resize(width: number, height: number): void {
    view.width = Math.max(1, width);
    view.height = Math.max(1, height);
    this.canvas.width = Math.round(view.width * devicePixelRatio);
    this.canvas.height = Math.round(view.height * devicePixelRatio);
    this.isMeasured = width > 0 && height > 0;
    this.paint();
  }

  /** Draw soon, as soon as no more comes. */
  request(): void {
    if (document.hidden) return;
    const sinceMs = this.due?.sinceMs ?? performance.now();
    if (this.due !== null) {
      if (performance.now() - sinceMs > PATIENCE_MS) return;
      clearTimeout(this.due.timer);
    }
    const timer = setTimeout(() => {
      this.due = null;
      this.paint();
    }, PAUSE_MS);
    this.due = { timer, sinceMs };
  }

  /** Show all of the map, or the robot where there is none. */
  fit(): void {
    const bounds = boundsOf(topics.LiveMap.newest.peek() ?? topics.GivenMap.newest.peek()?.map ?? null);
    const here = pose();
    if (bounds !== null) view.fit(...bounds);
    else if (here !== null) {
      const half = FIRST_SIZE_M / 2;
      view.fit(here.x_m - half, here.y_m - half, here.x_m + half, here.y_m + half);
    }
    this.request();
  }

  private paint(): void {
    if (!this.isMeasured) return;
    const { context } = this;
    const here = pose();
    this.placeFirst();
    if (follows.peek() && here !== null) [view.x_m, view.y_m] = [here.x_m, here.y_m];
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.palette.ground;
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    view.apply(context, devicePixelRatio);
    const nowMs = performance.now();
    const scene: Scene = { context, colours: this.palette, view, pixel: 1 / view.scale, nowMs, pose: here };
    for (const layer of LAYERS) {
      if (shown.peek()[layer.name] === true) layer.draw(scene);
    }
    drawDraft(scene);
    this.canvas.dispatchEvent(
      new CustomEvent("drawn", { detail: topics.ControlState.newest.peek()?.stamp_ns ?? 0 }),
    );
  }

  /** Choose what to show first: the robot, then the map once there is one, unless somebody has chosen. */
  private placeFirst(): void {
    const isMapped = topics.GivenMap.newest.peek() !== null || topics.LiveMap.newest.peek() !== null;
    const wanted = isMapped ? "map" : pose() === null ? "nothing" : "robot";
    if (view.isChosen || this.firstShown === "map" || wanted === this.firstShown) return;
    this.firstShown = wanted;
    this.fit();
  }
}

function boundsOf(map: LiveMap | null): [number, number, number, number] | null {
  if (map === null || map.rows === 0 || map.columns === 0) return null;
  const [width, height] = [map.columns * map.resolution_m, map.rows * map.resolution_m];
  const [c, s] = [Math.cos(map.theta_rad), Math.sin(map.theta_rad)];
  const corners = [[0, 0], [width, 0], [0, height], [width, height]] as const;
  const xs = corners.map(([x, y]) => map.x_m + c * x - s * y);
  const ys = corners.map(([x, y]) => map.y_m + s * x + c * y);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

function drawDraft(scene: Scene): void {
  const chosen = draft.peek();
  if (chosen === null) return;
  const { goal } = scene.colours;
  ring(scene, ...chosen.at, DRAFT_PX * scene.pixel, goal);
  if (chosen.heading_rad === null) dots(scene, [chosen.at], goal, 4);
  else arrow(scene, draftPose(chosen), goal);
}
