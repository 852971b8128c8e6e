import { topics } from "../../robot/robot";
import { drawNewest } from "./fade";
import { GridImage, rgb } from "./grid_image";
import type { Layer } from "./layer";

const image = new GridImage();
const DENSEST = 150;

/** How dear places around the robot are; the densest are those where its body touches something. */
export const costs: Layer = {
  name: "costs",
  isShown: false,
  draw(scene) {
    const { cost } = scene.colours;
    const [red, green, blue] = rgb(cost);
    drawNewest(topics.PlanView, scene, ({ costs: map }) =>
      image.draw(scene, map, cost, (value) => [red, green, blue, value <= 0 ? 0 : 20 + value * ((DENSEST - 20) / 100)]),
    );
  },
};
