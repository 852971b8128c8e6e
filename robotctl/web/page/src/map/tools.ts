// What a click on the map does, and which part of it is shown.

import { signal } from "@preact/signals";

import { keep, kept } from "../kept";
import { addPoint, gripAt, movePoint, type Grip } from "../plans/editor";
import { addCorner } from "../plans/polygons";
import type { Point, Pose } from "../robot/se2";
import { ask } from "../wire/live";
import { words } from "../words";
import { LAYERS } from "./layers/registry";
import { View } from "./view";

/** The last two are of panels. */
export type Tool = "look" | "go" | "place" | "point" | "corner";
export const TOOLS: readonly Tool[] = ["look", "go", "place"];

/** A pose that is being chosen; without a heading any will do. */
export interface Draft {
  readonly at: Point;
  readonly heading_rad: number | null;
  /** The point of the drawn mission that is being moved. */
  readonly grip?: Grip | undefined;
}

const LAYERS_KEY = "layers";

export const view = new View();
export const tool = signal<Tool>("look");
export const follows = signal(false);
export const draft = signal<Draft | null>(null);
export const shown = signal<Readonly<Record<string, boolean>>>({
  ...Object.fromEntries(LAYERS.map((layer) => [layer.name, layer.isShown])),
  ...kept<Record<string, boolean>>(LAYERS_KEY, {}),
});

export function toggleLayer(name: string): void {
  shown.value = { ...shown.value, [name]: shown.value[name] !== true };
  keep(LAYERS_KEY, shown.value);
}

/** Do what the tool is for, at a chosen place. */
export function use({ at, heading_rad, grip }: Draft): void {
  const [x_m, y_m] = at;
  if (tool.value === "go") {
    ask(words.tools.go, { type: "GoTo", x_m, y_m, heading_rad });
  } else if (tool.value === "place") {
    ask(words.tools.place, { type: "PlaceRobot", x_m, y_m, theta_rad: heading_rad ?? 0 });
    tool.value = "look"; // a robot is placed once; a second click would be a slip
  } else if (tool.value === "point") {
    if (grip === undefined) addPoint(at, heading_rad);
    else movePoint(grip, at);
  } else if (tool.value === "corner") {
    addCorner(at);
  }
}

const GRIP_PX = 14;

/** The drawn point that a press at a place takes hold of. */
export function grip(at: Point): Grip | undefined {
  return tool.peek() === "point" ? (gripAt(at, GRIP_PX / view.scale) ?? undefined) : undefined;
}

/** The pose of a draft, for drawing. */
export function draftPose({ at, heading_rad }: Draft): Pose {
  return { x_m: at[0], y_m: at[1], theta_rad: heading_rad ?? 0 };
}
