import { topics } from "../../robot/robot";
import { GridImage, occupancy } from "./grid_image";
import type { Layer } from "./layer";

const image = new GridImage();

/** The map that the localiser was given; it does not age. */
export const givenMap: Layer = {
  name: "givenMap",
  isShown: true,
  draw(scene) {
    const { free, wall } = scene.colours;
    const given = topics.GivenMap.newest.peek();
    if (given !== null) image.draw(scene, given.map, free + wall, occupancy(free, wall));
  },
};
