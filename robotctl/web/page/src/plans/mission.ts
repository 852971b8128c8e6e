// A mission as the tables of its file, and the file of such tables.

import type { Point, Pose } from "../robot/se2";

export interface Item {
  readonly kind: string;
  readonly [key: string]: unknown;
}

export interface Mission {
  readonly name: string;
  readonly item: readonly Item[];
  readonly [key: string]: unknown;
}

/** Keys of the items that the page can add, with the values that they begin with; null: they may be left out. */
export const KINDS: Readonly<Record<string, Readonly<Record<string, number | string | boolean | null>>>> = {
  goto: { name: null, x_m: 0, y_m: 0, heading_deg: null, tolerance_m: null, speed_m_s: null, time_out_s: null },
  straight_to: { name: null, x_m: 0, y_m: 0, speed_m_s: null, time_out_s: null },
  wait: { name: null, duration_s: 5 },
  wait_for: { name: null, go_ahead: true, charge_percent: null, clear_ahead_m: null, time_out_s: null },
  keep_distance: { name: null, distance_m: 0.5, duration_s: 10, speed_m_s: null },
  circle: { name: null, x_m: 0, y_m: 0, radius_m: 1, turns: null, side: null, speed_m_s: null, time_out_s: null },
  turn_to: { name: null, heading_deg: 0 },
  explore: { name: null, speed_m_s: null, time_out_s: null },
  repeat: { first: 1, times: 2 },
};

export function newItem(kind: string): Item {
  const begin = Object.entries(KINDS[kind] ?? {}).filter(([, value]) => value !== null);
  return { kind, ...Object.fromEntries(begin) };
}

export function newMission(start: Pose | null): Mission {
  const { x_m, y_m, theta_rad } = start ?? { x_m: 0, y_m: 0, theta_rad: 0 };
  const heading_deg = round((theta_rad * 180) / Math.PI);
  return { name: "page", start: { x_m: round(x_m), y_m: round(y_m), heading_deg }, item: [] };
}

/** Where an item leads, in order; empty: nowhere. */
export function pointsOfItem(item: Item): readonly Point[] {
  if (typeof item.x_m === "number" && typeof item.y_m === "number") return [[item.x_m, item.y_m]];
  return Array.isArray(item.waypoints) ? (item.waypoints as Point[]) : [];
}

/** Millimetres are enough for a finger. */
export function round(value: number): number {
  return Math.round(value * 1000) / 1000;
}

/** The file of a mission. */
export function toml(mission: Mission): string {
  const plain = Object.entries(mission).filter(([, value]) => !isTables(value));
  const tables = Object.entries(mission).filter(([, value]) => isTables(value));
  const lines = plain.map(pair);
  for (const [key, rows] of tables) {
    for (const row of rows as object[]) lines.push("", `[[${name(key)}]]`, ...Object.entries(row).map(pair));
  }
  return `${lines.join("\n")}\n`;
}

const isTables = (value: unknown) =>
  Array.isArray(value) && value.length > 0 && value.every((each) => typeof each === "object" && !Array.isArray(each));

const pair = ([key, value]: readonly [string, unknown]) => `${name(key)} = ${text(value)}`;

const name = (key: string) => (/^[A-Za-z0-9_-]+$/.test(key) ? key : JSON.stringify(key));

function text(value: unknown): string {
  if (Array.isArray(value)) return `[${value.map(text).join(", ")}]`;
  if (typeof value === "object" && value !== null) {
    const inner = Object.entries(value).map(pair).join(", ");
    return inner === "" ? "{}" : `{ ${inner} }`;
  }
  return JSON.stringify(value).replaceAll("\u007f", "\\u007f");
}
