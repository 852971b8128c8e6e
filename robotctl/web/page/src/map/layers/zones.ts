import { topics } from "../../robot/robot";
import { words } from "../../words";
import type { Layer } from "./layer";
import { label, middle, polygon } from "./polygon";

/** Where what drives by plan keeps out, or drives slowly; these do not age. */
export const zones: Layer = {
  name: "zones",
  isShown: true,
  draw(scene) {
    const { keepout, slow } = scene.colours;
    for (const zone of topics.BoundsView.newest.peek()?.zones ?? []) {
      const colour = zone.speed_m_s === 0 ? keepout : slow;
      polygon(scene, zone.corners, colour, true);
      label(scene, middle(zone.corners), words.bounds.zone(zone.name, zone.speed_m_s), colour);
    }
  },
};
