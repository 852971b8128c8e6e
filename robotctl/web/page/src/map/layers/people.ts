import { topics } from "../../robot/robot";
import { line, ring } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Time of motion that is drawn ahead of what moves [s]. */
const AHEAD_S = 1;

/** What moves by itself, and where to. */
export const people: Layer = {
  name: "people",
  isShown: true,
  draw(scene) {
    drawNewest(topics.PlanView, scene, ({ moving }) => {
      for (const [x, y, vx, vy, radius] of moving) {
        ring(scene, x, y, radius, scene.colours.person);
        line(scene, [[x, y], [x + AHEAD_S * vx, y + AHEAD_S * vy]], scene.colours.person);
      }
    });
  },
};
