// Old pictures: grey at first, then gone.

import type { Stamped, Topic } from "../../robot/topic";
import type { Scene } from "./layer";

const GONE_MS = 5000;
const STALE_ALPHA = 0.35;

/** Draw the newest message, pale if it is old, and not at all if it is long ago. */
export function drawNewest<T extends Stamped>(topic: Topic<T>, scene: Scene, draw: (message: T) => void): void {
  const message = topic.newest.peek();
  if (message === null || topic.ageMs(scene.nowMs) > GONE_MS) return;
  scene.context.globalAlpha = topic.isStale(scene.nowMs) ? STALE_ALPHA : 1;
  draw(message);
  scene.context.globalAlpha = 1;
}
