import { topics } from "../../robot/robot";
import type { Layer } from "./layer";
import { polygon } from "./polygon";
import { ring } from "./drawing";

/** Bounds of all motion: dashed while the robot need not keep to them. */
export const fence: Layer = {
  name: "fence",
  isShown: true,
  draw(scene) {
    const { context, colours, pixel } = scene;
    const bounds = topics.BoundsView.newest.peek();
    if (bounds === null) return;
    const [polygons, circles] = bounds.fence;
    context.setLineDash(bounds.fence_enabled ? [] : [6 * pixel, 5 * pixel]);
    for (const [corners, keeps_in] of polygons) polygon(scene, corners, colours.fence, !keeps_in);
    for (const [x, y, radius] of circles) ring(scene, x, y, radius, colours.fence);
    context.setLineDash([]);
  },
};
