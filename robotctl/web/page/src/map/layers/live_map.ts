import { topics } from "../../robot/robot";
import { GridImage, occupancy } from "./grid_image";
import type { Layer } from "./layer";

const image = new GridImage();

/** The map as it grows: it stays when the robot has mapped everything. */
export const liveMap: Layer = {
  name: "liveMap",
  isShown: true,
  draw(scene) {
    const { free, wall } = scene.colours;
    const map = topics.LiveMap.newest.peek();
    if (map !== null) image.draw(scene, map, free + wall, occupancy(free, wall));
  },
};
