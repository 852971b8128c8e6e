import { topics } from "../../robot/robot";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Chi of 95 % in the plane: sqrt(-2 ln 0.05). */
const CHI_95 = 2.448;

/** Ellipse that holds the robot's place with 95 %, if the belief is a Gaussian. */
export const covariance: Layer = {
  name: "covariance",
  isShown: true,
  draw(scene) {
    const { context, pixel, colours, pose } = scene;
    if (pose === null) return;
    drawNewest(topics.LocalisationState, scene, (state) => {
      const [xx = 0, xy = 0, , yy = 0] = state.covariance;
      const mean = (xx + yy) / 2;
      const half = Math.hypot((xx - yy) / 2, xy);
      const radius = (variance: number) => CHI_95 * Math.sqrt(Math.max(variance, 0));
      const turn = Math.atan2(2 * xy, xx - yy) / 2;
      context.beginPath();
      context.ellipse(pose.x_m, pose.y_m, radius(mean + half), radius(mean - half), turn, 0, 2 * Math.PI);
      context.strokeStyle = colours.covariance;
      context.lineWidth = 2 * pixel;
      context.stroke();
    });
  },
};
