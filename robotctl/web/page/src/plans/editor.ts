// The mission that the robot has, and the one that is being drawn: each step of that can be undone.

import { computed, effect, signal } from "@preact/signals";

import { hello, pose, topics } from "../robot/robot";
import type { Point } from "../robot/se2";
import { words } from "../words";
import { newItem, newMission, pointsOfItem, round, toml, type Item, type Mission } from "./mission";
import { readToml, sendPlan, sentMission } from "./send";

const MOST_UNDONE = 100;

/** The robot's mission; null: it has none. */
export const present = signal<Mission | null>(null);
/** The mission that is drawn; null: none is. */
export const edited = signal<Mission | null>(null);
/** Number of the chosen item, from 0. */
export const chosen = signal<number | null>(null);
const past = signal<readonly Mission[]>([]);
export const canUndo = computed(() => past.value.length > 0);

export function startEditor(): void {
  effect(() => {
    const view = topics.MissionView.newest.value;
    if (view === null || view.content.length === 0) {
      present.value = null;
      return;
    }
    void readToml<Mission>(words.mission.name, view.content).then((mission) => {
      if (topics.MissionView.newest.peek() === view) present.value = mission;
    });
  });
}

/** Begin to draw: a new mission, or a copy of one. */
export function edit(mission: Mission | null): void {
  past.value = [];
  chosen.value = null;
  edited.value = mission ?? newMission(pose());
}

export function stopEditing(): void {
  edited.value = null;
  chosen.value = null;
}

export function undo(): void {
  const before = past.value.at(-1);
  if (before === undefined) return;
  past.value = past.value.slice(0, -1);
  chosen.value = null;
  edited.value = before;
}

export function change(part: Partial<Mission>): void {
  const mission = edited.peek();
  if (mission === null) return;
  past.value = [...past.peek(), mission].slice(-MOST_UNDONE);
  edited.value = { ...mission, ...part } as Mission;
}

const items = () => edited.peek()?.item ?? [];

/** Add an item behind the chosen one, or at the end. */
export function addItem(item: Item): void {
  const at = chosen.peek() === null ? items().length : (chosen.peek() as number) + 1;
  change({ item: [...items().slice(0, at), item, ...items().slice(at)] });
  chosen.value = at;
}

export function addPoint([x, y]: Point, heading_rad: number | null): void {
  if (edited.peek() === null) edit(null);
  const robot = hello.peek();
  const plans = robot === null || robot.has_lidar || robot.has_localiser; // else it drives straight, to any heading
  const heading = heading_rad === null || !plans ? {} : { heading_deg: round((heading_rad * 180) / Math.PI) };
  addItem({ ...newItem(plans ? "goto" : "straight_to"), x_m: round(x), y_m: round(y), ...heading });
}

/** Set a key of an item; undefined takes it out. */
export function setKey(number: number, key: string, value: unknown): void {
  change({
    item: items().map((item, i) => {
      if (i !== number) return item;
      const { [key]: _before, ...rest } = item;
      return (value === undefined ? rest : { ...item, [key]: value }) as Item;
    }),
  });
}

export function removeItem(number: number): void {
  chosen.value = null;
  change({ item: items().filter((_, i) => i !== number) });
}

/** Let an item change places with the one before or behind it. */
export function shiftItem(number: number, by: 1 | -1): void {
  const [item, other] = [items()[number], items()[number + by]];
  if (item === undefined || other === undefined) return;
  change({ item: items().map((each, i) => (i === number ? other : i === number + by ? item : each)) });
  chosen.value = number + by;
}

/** A drawn point: item, and which of its points. */
export type Grip = readonly [item: number, point: number];

/** The point nearest to a place, if one is within a distance [m]. */
export function gripAt([x, y]: Point, within_m: number): Grip | null {
  let [best, least]: [Grip | null, number] = [null, within_m];
  for (const [i, item] of items().entries()) {
    for (const [k, [px, py]] of pointsOfItem(item).entries()) {
      const away = Math.hypot(px - x, py - y);
      if (away < least) [best, least] = [[i, k], away];
    }
  }
  return best;
}

export function movePoint([number, point]: Grip, [x, y]: Point): void {
  const to = [round(x), round(y)];
  chosen.value = number;
  change({
    item: items().map((item, i) => {
      if (i !== number) return item;
      if (!Array.isArray(item.waypoints)) return { ...item, x_m: to[0], y_m: to[1] };
      return { ...item, waypoints: item.waypoints.map((each, k) => (k === point ? to : each)) };
    }),
  });
}

/** Send the drawn mission; the robot's own is then this one, if it takes it. */
export async function upload(): Promise<void> {
  const mission = edited.peek();
  if (mission === null) return;
  const crc = await sendPlan(words.mission.upload, { type: "MissionUpload", text: toml(mission) });
  sentMission.value = crc === null ? null : { crc };
}
