import { topics } from "../../robot/robot";
import { line, pointsOf } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** The rest of the planned path. */
export const plan: Layer = {
  name: "plan",
  isShown: true,
  draw(scene) {
    drawNewest(topics.PlanView, scene, ({ path }) => line(scene, pointsOf(path, 3), scene.colours.plan, 3));
  },
};
