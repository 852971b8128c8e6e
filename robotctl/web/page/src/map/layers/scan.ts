import { topics } from "../../robot/robot";
import { apply, type Point, type Pose } from "../../robot/se2";
import type { LidarScan } from "../../wire/messages";
import { floats } from "../../wire/msgpack";
import { dots } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Where the beams of the lidar ended. */
export const scan: Layer = {
  name: "scan",
  isShown: true,
  draw(scene) {
    const { pose } = scene;
    if (pose === null) return;
    drawNewest(topics.LidarScan, scene, (message) => dots(scene, ends(message, pose), scene.colours.scan));
  },
};

function* ends(message: LidarScan, pose: Pose): Generator<Point> {
  const { x_m, y_m, first_rad, step_rad } = message;
  for (const [i, range] of floats(message.ranges).entries()) {
    if (!Number.isFinite(range)) continue;
    const angle = first_rad + i * step_rad;
    yield apply(pose, x_m + range * Math.cos(angle), y_m + range * Math.sin(angle));
  }
}
