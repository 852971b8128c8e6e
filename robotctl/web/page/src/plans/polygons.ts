// Polygons drawn on the map: zones and the fence, which the robot keeps to once it has taken them.

import { signal } from "@preact/signals";

import { topics } from "../robot/robot";
import type { Point, Pose } from "../robot/se2";
import type { BoundsView } from "../wire/messages";
import { words } from "../words";
import { round } from "./mission";
import { sendPlan } from "./send";

export const SHAPES = ["keepOut", "slow", "fenceIn", "fenceOut"] as const;
export type Shape = (typeof SHAPES)[number];

/** Corners that are drawn so far; null: none is being drawn. */
export const corners = signal<readonly Point[] | null>(null);
export const shape = signal<Shape>("keepOut");
export const name = signal("");
export const speed_m_s = signal(0.2);

export const FEWEST = 3;

export function addCorner([x, y]: Point): void {
  corners.value = [...(corners.peek() ?? []), [round(x), round(y)]];
}

type Fence = BoundsView["fence"];
type Zones = BoundsView["zones"];

const bounds = () => topics.BoundsView.newest.peek();
const drawn = (): Zones => (bounds()?.zones ?? []).filter((zone) => zone.origin === "map");

/** Send the polygon as what it is to be. */
export async function close(): Promise<void> {
  const points = corners.peek();
  if (points === null || points.length < FEWEST) return;
  const isFence = shape.peek() === "fenceIn" || shape.peek() === "fenceOut";
  const [polygons, circles] = bounds()?.fence ?? [[], []];
  const zone = {
    name: name.peek() || words.bounds.nameless(drawn().length + 1),
    corners: points,
    speed_m_s: shape.peek() === "slow" ? speed_m_s.peek() : 0,
  };
  const isSent = isFence
    ? await sendFence([[...polygons, [points, shape.peek() === "fenceIn"]], circles])
    : await sendZones([...drawn(), { ...zone, origin: "map" }]);
  if (isSent) [corners.value, name.value] = [null, ""];
}

export const sendZones = async (zones: Zones): Promise<boolean> =>
  (await sendPlan(words.bounds.zones, { type: "ZonesUpload", zones })) !== null;

export const sendFence = async ([polygons, circles]: Fence): Promise<boolean> =>
  (await sendPlan(words.bounds.fence, { type: "FenceUpload", polygons, circles })) !== null;

export const removeZone = (removed: string) => sendZones(drawn().filter((zone) => zone.name !== removed));

export function removePolygon(number: number): void {
  const [polygons, circles] = bounds()?.fence ?? [[], []];
  void sendFence([polygons.filter((_, i) => i !== number), circles]);
}

export function removeCircle(number: number): void {
  const [polygons, circles] = bounds()?.fence ?? [[], []];
  void sendFence([polygons, circles.filter((_, i) => i !== number)]);
}

/** Whether a point is inside: a line from it crosses the sides an odd number of times. */
export function surrounds(polygon: readonly Point[], { x_m, y_m }: Pose): boolean {
  let inside = false;
  polygon.forEach(([x2, y2], i) => {
    const [x1, y1] = polygon.at(i - 1) as Point;
    if (y1 > y_m !== y2 > y_m && x_m < x1 + ((y_m - y1) / (y2 - y1)) * (x2 - x1)) inside = !inside;
  });
  return inside;
}
