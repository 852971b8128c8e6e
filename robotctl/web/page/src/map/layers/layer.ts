// A layer of the map. To add one: its file here, its line in registry.ts, its name in words.ts.

import type { Pose } from "../../robot/se2";
import type { words } from "../../words";
import type { Palette } from "../palette";
import type { View } from "../view";

/** What a layer draws with. The context is in metres of the world. */
export interface Scene {
  readonly context: CanvasRenderingContext2D;
  readonly colours: Palette;
  readonly view: View;
  /** Length of a pixel of the page [m]. */
  readonly pixel: number;
  readonly nowMs: number;
  /** `base` in `world`; null: unknown. */
  readonly pose: Pose | null;
}

export interface Layer {
  readonly name: keyof (typeof words)["layers"];
  /** Whether it is shown until somebody says otherwise. */
  readonly isShown: boolean;
  /** Draw what there is of it. */
  draw(scene: Scene): void;
}
