import { topics } from "../../robot/robot";
import { line, pointsOf } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Where the present velocity leads. */
export const arc: Layer = {
  name: "arc",
  isShown: true,
  draw(scene) {
    drawNewest(topics.PlanView, scene, (view) => line(scene, pointsOf(view.arc, 3), scene.colours.arc, 5));
  },
};
