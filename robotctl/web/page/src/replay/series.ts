// Plotted fields of a recording: each over its whole run, as soon as it is chosen.

import { doubles, floats } from "../wire/msgpack";
import { decode } from "../wire/msgpack";
import type { Series } from "../wire/messages";
import { isFrame, query } from "./mode";

export type Table = readonly [number[], (number | null)[]];

const EMPTY: Table = [[], []];
const known = new Map<string, Table>();
const asked = new Set<string>();

/** Times since the beginning [s] and values of a field; empty until they have come. */
export function recorded(field: string): Table {
  return known.get(field) ?? EMPTY;
}

/** Fetch what is not there yet of some fields. */
export async function want(fields: readonly string[]): Promise<void> {
  const missing = fields.filter((field) => !asked.has(field));
  if (isFrame || missing.length === 0) return;
  for (const field of missing) asked.add(field);
  const names = missing.map((field) => `field=${encodeURIComponent(field)}`).join("&");
  try {
    const answer = await fetch(`/series${query === "" ? "?" : `${query}&`}${names}`);
    if (!answer.ok) throw new Error(await answer.text());
    for (const each of decode(new Uint8Array(await answer.arrayBuffer())) as Series[]) {
      const values = Array.from(floats(each.values), (value) => (Number.isFinite(value) ? value : null));
      known.set(each.field, [Array.from(doubles(each.times_s)), values]);
    }
  } catch {
    for (const field of missing) asked.delete(field); // asked again when the fields change
  }
}
