import { topics } from "../../robot/robot";
import { dots, pointsOf } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Places where the localiser thinks that the robot may be. */
export const particles: Layer = {
  name: "particles",
  isShown: true,
  draw(scene) {
    drawNewest(topics.ParticleCloud, scene, ({ poses }) =>
      dots(scene, pointsOf(poses, 3), scene.colours.particle),
    );
  },
};
