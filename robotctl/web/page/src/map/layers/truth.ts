import { topics } from "../../robot/robot";
import { outline } from "./outline";
import { dots } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** In a simulation: where the robot and people truly are. */
export const truth: Layer = {
  name: "truth",
  isShown: true,
  draw(scene) {
    const { context, colours, pixel } = scene;
    drawNewest(topics.Truth, scene, (state) => {
      context.setLineDash([5 * pixel, 4 * pixel]);
      outline(scene, state, state.body, colours.truth);
      context.setLineDash([]);
      dots(scene, state.people, colours.truth, 8);
    });
  },
};
