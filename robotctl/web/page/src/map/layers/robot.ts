import { topics } from "../../robot/robot";
import { arrow } from "./drawing";
import type { Layer } from "./layer";
import { outline } from "./outline";

const FILL_ALPHA = 0.25;
const OLD_ALPHA = 0.35;
const HEADING_PX = 14;

/** The robot's body, and where its front is; it never vanishes, it only goes grey. */
export const robot: Layer = {
  name: "robot",
  isShown: true,
  draw(scene) {
    const { context, pose, colours, nowMs } = scene;
    if (pose === null) return;
    const alpha = topics.ControlState.isStale(nowMs) ? OLD_ALPHA : 1;
    context.globalAlpha = alpha;
    outline(scene, pose, topics.NavigationState.newest.peek()?.body ?? 0, colours.robot);
    context.globalAlpha = FILL_ALPHA * alpha;
    context.fillStyle = colours.robot;
    context.fill();
    context.globalAlpha = alpha;
    arrow(scene, pose, colours.robot, HEADING_PX);
    context.globalAlpha = 1;
  },
};
