import { topics } from "../../robot/robot";
import { apply, type Point, type Pose } from "../../robot/se2";
import type { LidarScan } from "../../wire/messages";
import { floats } from "../../wire/msgpack";
import { dots } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

const APART_NS = 500_000_000;

/** The last scan of each lidar, by its name. */
const last = new Map<string, LidarScan>();

/** Where the beams of the lidars ended. */
export const scan: Layer = {
  name: "scan",
  isShown: true,
  draw(scene) {
    const { pose } = scene;
    if (pose === null) return;
    drawNewest(topics.LidarScan, scene, (message) => {
      for (const each of together(message)) dots(scene, ends(each, pose), scene.colours.scan);
    });
  },
};

/** The scans of about one time; a replay may have jumped since the others. */
function together(message: LidarScan): Iterable<LidarScan> {
  last.set(message.name, message);
  for (const [name, each] of last)
    if (Math.abs(message.stamp_ns - each.stamp_ns) > APART_NS) last.delete(name);
  return last.values();
}

function* ends(message: LidarScan, pose: Pose): Generator<Point> {
  const { x_m, y_m, first_rad, step_rad } = message;
  for (const [i, range] of floats(message.ranges).entries()) {
    if (!Number.isFinite(range)) continue;
    const angle = first_rad + i * step_rad;
    yield apply(pose, x_m + range * Math.cos(angle), y_m + range * Math.sin(angle));
  }
}
