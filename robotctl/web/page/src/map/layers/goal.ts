import { topics } from "../../robot/robot";
import { drawNewest } from "./fade";
import { dots, ring } from "./drawing";
import type { Layer } from "./layer";

const RADIUS_PX = 9;

/** Where the robot drives now. */
export const goal: Layer = {
  name: "goal",
  isShown: true,
  draw(scene) {
    drawNewest(topics.NavigationState, scene, (state) => {
      if (state.goal === null) return;
      const [x, y] = state.goal;
      ring(scene, x, y, RADIUS_PX * scene.pixel, scene.colours.goal);
      dots(scene, [[x, y]], scene.colours.goal, 6);
    });
  },
};
