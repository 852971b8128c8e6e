import { hello, topics } from "../../robot/robot";
import { apply } from "../../robot/se2";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Half of the angle that is drawn for a cone [rad]. */
const HALF_CONE = 0.26;
const ALPHA = 0.12;

/** Cones of the sonars, up to the echo. */
export const sonar: Layer = {
  name: "sonar",
  isShown: true,
  draw(scene) {
    const { context, pose, colours, pixel } = scene;
    const mounts = hello.peek()?.sonars ?? [];
    if (pose === null) return;
    drawNewest(topics.ControlState, scene, ({ sonar_m }) => {
      context.fillStyle = colours.sonar;
      context.strokeStyle = colours.sonar;
      context.lineWidth = 2 * pixel;
      const alpha = context.globalAlpha;
      for (const [i, mount] of mounts.entries()) {
        const range = sonar_m[i] ?? Number.NaN;
        if (!Number.isFinite(range)) continue;
        const [x, y] = apply(pose, mount.x_m, mount.y_m);
        const heading = pose.theta_rad + mount.heading_rad;
        context.beginPath();
        context.moveTo(x, y);
        context.arc(x, y, range, heading - HALF_CONE, heading + HALF_CONE);
        context.globalAlpha = ALPHA * alpha;
        context.fill();
        context.beginPath();
        context.arc(x, y, range, heading - HALF_CONE, heading + HALF_CONE);
        context.globalAlpha = alpha;
        context.stroke();
      }
    });
  },
};
