import { chosen, edited, present } from "../../plans/editor";
import { pointsOfItem, type Mission } from "../../plans/mission";
import { corners } from "../../plans/polygons";
import { topics } from "../../robot/robot";
import type { Point } from "../../robot/se2";
import { arrow, dots, line, ring } from "./drawing";
import type { Layer, Scene } from "./layer";
import { label } from "./polygon";

const RING_PX = 8;
const DONE_ALPHA = 0.35;

/** The robot's mission, or the one that is drawn now, and the polygon that is. */
export const mission: Layer = {
  name: "mission",
  isShown: true,
  draw(scene) {
    const drawn = edited.peek();
    const state = topics.NavigationState.newest.peek();
    if (drawn !== null) show(scene, drawn, chosen.peek(), 0);
    else if (present.peek() !== null && state !== null) {
      show(scene, present.peek() as Mission, state.mission_completed ? null : state.item, state.item);
    }
    const points = corners.peek() ?? [];
    line(scene, points, scene.colours.mission, 2);
    dots(scene, points, scene.colours.mission, 7);
  },
};

/** Draw a mission: what is done is pale, the present item filled, the next ones rings. */
function show(scene: Scene, { item }: Mission, now: number | null, done: number): void {
  const { context, colours, pixel } = scene;
  const way = item.flatMap((each) => pointsOfItem(each));
  context.setLineDash([8 * pixel, 4 * pixel]);
  line(scene, way, colours.mission, 2);
  context.setLineDash([]);
  let last: Point | null = null;
  let standing = "";
  for (const [i, each] of item.entries()) {
    context.globalAlpha = i < done ? DONE_ALPHA : 1;
    const points = pointsOfItem(each);
    if (points.length === 0) {
      standing += ` ${i + 1}`;
      continue;
    }
    if (last !== null && standing !== "") label(scene, last, `     +${standing}`, colours.mission);
    standing = "";
    for (const point of points) dots(scene, [point], colours.mission, 6);
    last = points.at(-1) as Point;
    ring(scene, ...last, RING_PX * pixel, colours.mission);
    if (i === now) {
      context.fillStyle = colours.mission;
      context.fill();
    }
    if (typeof each.heading_deg === "number") {
      const theta_rad = (each.heading_deg * Math.PI) / 180;
      arrow(scene, { x_m: last[0], y_m: last[1], theta_rad }, colours.mission, 22);
    }
    label(scene, last, `${i + 1}`, colours.mission);
  }
  if (last !== null && standing !== "") label(scene, last, `     +${standing}`, colours.mission);
  context.globalAlpha = 1;
}
