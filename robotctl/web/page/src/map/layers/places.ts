import { topics } from "../../robot/robot";
import { dots, line, ring } from "./drawing";
import type { Layer } from "./layer";
import { label } from "./polygon";

/** Places of the topological map, and the passages between them. */
export const places: Layer = {
  name: "places",
  isShown: true,
  draw(scene) {
    const bounds = topics.BoundsView.newest.peek();
    const { place } = scene.colours;
    for (const [a, b] of bounds?.links ?? []) {
      const ends = [bounds?.places[a], bounds?.places[b]].map((each) => [each?.x_m ?? 0, each?.y_m ?? 0] as const);
      line(scene, ends, place, 1);
    }
    for (const { name, x_m, y_m } of bounds?.places ?? []) {
      dots(scene, [[x_m, y_m]], place, 7);
      label(scene, [x_m, y_m], name, place);
    }
  },
};

/** Where the robot returns to: home, and the rally points that are nearer. */
export const returns: Layer = {
  name: "returns",
  isShown: true,
  draw(scene) {
    const bounds = topics.BoundsView.newest.peek();
    if (bounds === null) return;
    const [x, y] = bounds.home;
    label(scene, [x, y], "⌂", scene.colours.place);
    for (const each of bounds.rally) {
      ring(scene, ...each, 6 * scene.pixel, scene.colours.place);
      label(scene, each, "R", scene.colours.place);
    }
  },
};
