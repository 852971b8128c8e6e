// What the chosen fields were: a column a field, a table a topic, since each topic has times of its own.

import { effect, signal } from "@preact/signals";

import { keep, kept } from "../kept";
import { isReplay } from "../replay/mode";
import { recorded, want } from "../replay/series";
import { topics, watch, type TopicName } from "../robot/robot";
import type { Stamped } from "../robot/topic";
import { split, valueAt } from "./fields";

const KEY = "plots";
/** Ten minutes at 20 Hz; older rows go, some at a time. */
const MOST_ROWS = 12_000;
const DROPPED_ROWS = 1000;

type Column = (number | null)[];

/** Rows of one topic: robot's time [s], and values by path. */
export interface Table {
  readonly times: number[];
  readonly columns: Map<string, Column>;
}

export const chosen = signal<readonly string[]>(kept(KEY, ["ControlState.v_m_s", "ControlState.v_ref_m_s"]));
const tables = new Map<TopicName, Table>();

export function choose(field: string): void {
  if (!chosen.value.includes(field)) change([...chosen.value, field]);
}

export function dismiss(field: string): void {
  change(chosen.value.filter((each) => each !== field));
}

function change(fields: readonly string[]): void {
  chosen.value = fields;
  keep(KEY, fields);
  prepare();
}

/** Make tables and columns for the chosen fields, and none for others. */
function prepare(): void {
  const wanted = new Map<TopicName, Set<string>>();
  for (const [topic, path] of chosen.peek().map(split)) {
    if (topic in topics) wanted.set(topic, (wanted.get(topic) ?? new Set()).add(path));
  }
  for (const topic of tables.keys()) if (!wanted.has(topic)) tables.delete(topic);
  for (const [topic, paths] of wanted) {
    const before = tables.get(topic);
    const times = before?.times ?? [];
    const columns = [...paths].map(
      (path): [string, Column] => [path, before?.columns.get(path) ?? times.map(() => null)],
    );
    tables.set(topic, { times, columns: new Map(columns) });
  }
}

export function startHistory(): void {
  if (isReplay) {
    startRecorded();
    return;
  }
  prepare();
  watch(record);
}

/** Fetch what is chosen, here or in a page beside this one. */
function startRecorded(): void {
  effect(() => void want(chosen.value));
  addEventListener("storage", () => {
    const others = kept(KEY, chosen.peek());
    if (others.join() !== chosen.peek().join()) chosen.value = others;
  });
}

function record(topic: TopicName, message: Stamped): void {
  const table = tables.get(topic);
  if (table === undefined) return;
  const time = message.stamp_ns / 1e9;
  const last = table.times.at(-1);
  if (last !== undefined && time <= last) {
    if (time === last) return; // repeated
    clear(table); // another robot, or another boot of its computer
  }
  table.times.push(time);
  for (const [path, column] of table.columns) column.push(valueAt(message, path));
  if (table.times.length > MOST_ROWS) {
    table.times.splice(0, DROPPED_ROWS);
    for (const column of table.columns.values()) column.splice(0, DROPPED_ROWS);
  }
}

function clear(table: Table): void {
  table.times.length = 0;
  for (const column of table.columns.values()) column.length = 0;
}

/** Times and values of a field; empty where nothing was recorded. */
export function series(field: string): readonly [number[], Column] {
  if (isReplay) return recorded(field);
  const [topic, path] = split(field);
  const table = tables.get(topic);
  return [table?.times ?? [], table?.columns.get(path) ?? []];
}
