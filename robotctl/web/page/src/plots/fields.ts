// The numbers within messages, by name: `ControlState.duty[0]`.

import { isReplay } from "../replay/mode";
import { topics, type TopicName } from "../robot/robot";

/** Times are no figures. */
const TIMES = /stamp_ns(\[\d+\])?$|_epoch_ns$|^epoch_ns$/;
const DRAWN = new Set<TopicName>([
  ...(isReplay ? (["Truth"] as const) : []),
  ...(["GivenMap", "LiveMap", "ParticleCloud", "LidarScan", "PlanView", "SlamGraph"] as const),
  ...(["MissionView", "BoundsView", "CameraPicture", "RecorderState"] as const),
]);

/** Topic and path of a field, which is named with a dot between them. */
export function split(field: string): readonly [TopicName, string] {
  const dot = field.indexOf(".");
  return [field.slice(0, dot) as TopicName, field.slice(dot + 1)];
}

/** Names of all fields that have been published so far. */
export function fieldNames(): string[] {
  const found: string[] = [];
  for (const [name, topic] of Object.entries(topics)) {
    const message = topic.newest.peek();
    if (message === null || DRAWN.has(name as TopicName)) continue;
    for (const [path] of numbers(message, "")) found.push(`${name}.${path}`);
  }
  return found;
}

function* numbers(value: unknown, path: string): Generator<readonly [string, number]> {
  if (typeof value === "number") {
    if (!TIMES.test(path)) yield [path, value];
  } else if (typeof value === "boolean") {
    yield [path, value ? 1 : 0];
  } else if (Array.isArray(value)) {
    for (const [i, each] of value.entries()) yield* numbers(each, `${path}[${i}]`);
  } else if (typeof value === "object" && value !== null && !(value instanceof Uint8Array)) {
    for (const [key, each] of Object.entries(value)) yield* numbers(each, path === "" ? key : `${path}.${key}`);
  }
}

/** Value at a path of a message; null: there is none now. */
export function valueAt(message: unknown, path: string): number | null {
  let found: unknown = message;
  for (const key of path.split(/[.[\]]+/).filter(Boolean)) {
    if (typeof found !== "object" || found === null) return null;
    found = (found as Record<string, unknown>)[key];
  }
  if (typeof found === "boolean") return found ? 1 : 0;
  return typeof found === "number" && Number.isFinite(found) ? found : null;
}

const UNITS: readonly (readonly [RegExp, string])[] = [
  [/_m_s2(\[\d+\])?$/, "m/s²"],
  [/_m_s(\[\d+\])?$/, "m/s"],
  [/_rad_s(\[\d+\])?$/, "rad/s"],
  [/_rad(\[\d+\])?$/, "rad"],
  [/_m(\[\d+\])?$/, "m"],
  [/_v(\[\d+\])?$/, "V"],
  [/_a(\[\d+\])?$/, "A"],
  [/_c(\[\d+\])?$/, "°C"],
  [/_us(_\w+)?$/, "µs"],
  [/_ns$/, "ns"],
  [/_hz$/, "Hz"],
];

/** Unit of a field, by its name; empty: none. */
export function unitOf(field: string): string {
  return UNITS.find(([pattern]) => pattern.test(field))?.[1] ?? "";
}
