import { topics } from "../../robot/robot";
import { apply, type Point, type Pose } from "../../robot/se2";
import type { CameraView } from "../../wire/messages";
import { dots } from "./drawing";
import { drawNewest } from "./fade";
import type { Layer } from "./layer";

/** Where the camera sees the floor end, and things that stand on it. */
export const floor: Layer = {
  name: "floor",
  isShown: true,
  draw(scene) {
    const { pose } = scene;
    if (pose === null) return;
    drawNewest(topics.CameraView, scene, (view) => {
      dots(scene, ends(view, pose), scene.colours.floor);
      const seen = view.obstacles.map((thing) => apply(pose, thing.x_m, thing.y_m));
      dots(scene, seen, scene.colours.obstacle, 7);
    });
  },
};

function* ends(view: CameraView, pose: Pose): Generator<Point> {
  for (const [i, range] of view.ranges_m.entries()) {
    const angle = view.angles_rad[i];
    if (!Number.isFinite(range) || angle === undefined) continue;
    yield apply(pose, view.x_m + range * Math.cos(angle), view.y_m + range * Math.sin(angle));
  }
}
