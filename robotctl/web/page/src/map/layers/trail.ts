import { isReplay } from "../../replay/mode";
import { drivenPath } from "../../replay/playback";
import { trail as driven } from "../../robot/robot";
import { line } from "./drawing";
import type { Layer } from "./layer";

/** The path that the robot has driven. */
export const trail: Layer = {
  name: "trail",
  isShown: true,
  draw(scene) {
    for (const stretch of isReplay ? drivenPath() : driven.stretches) line(scene, stretch, scene.colours.trail, 2);
  },
};
