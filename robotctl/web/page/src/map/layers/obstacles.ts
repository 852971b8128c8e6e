import { topics } from "../../robot/robot";
import { dots, pointsOf } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** What the sensors have seen that is on no map. */
export const obstacles: Layer = {
  name: "obstacles",
  isShown: true,
  draw(scene) {
    drawNewest(topics.PlanView, scene, (view) =>
      dots(scene, pointsOf(view.obstacles, 2), scene.colours.obstacle, 4),
    );
  },
};
