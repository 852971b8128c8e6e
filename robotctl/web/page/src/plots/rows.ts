// The chosen fields on one axis of time.

import uPlot from "uplot";

import { series } from "./history";

/** Rows of a field that are drawn at most; of more the least and the greatest of each few are. */
const MOST_DRAWN = 4000;

/** Times [s] and a column a field, from a time to another; null where a field has no value. */
export function rows(fields: readonly string[], fromS: number, toS: number, most = Infinity): uPlot.AlignedData {
  const tables = fields.map(series).map(([times, values]): uPlot.AlignedData => {
    const [begin, end] = [firstAfter(times, fromS), firstAfter(times, toS)];
    return thinned(times.slice(begin, end + 1), values.slice(begin, end + 1), most);
  });
  const [first] = tables;
  if (first === undefined) return [[]];
  const isOneTopic = tables.every(([times]) => isSame(times, first[0]));
  return isOneTopic ? [first[0], ...tables.map(([, values]) => values as (number | null)[])] : uPlot.join(tables);
}

function firstAfter(times: readonly number[], wanted: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? 0) < wanted) low = middle + 1;
    else high = middle;
  }
  return low;
}

function isSame(a: ArrayLike<number>, b: ArrayLike<number>): boolean {
  return a.length === b.length && Array.prototype.every.call(a, (each, i) => each === b[i]);
}

/** Time of the newest row [s]. */
export function newestS(fields: readonly string[]): number {
  return Math.max(...fields.map((field) => series(field)[0].at(-1) ?? -Infinity));
}

/** Rows around a time, their times since that: a chart stands still while time goes on. */
export function around(fields: readonly string[], atS: number, [fromS, toS]: readonly [number, number]): uPlot.AlignedData {
  const [times, ...columns] = rows(fields, atS + fromS, atS + toS, MOST_DRAWN);
  return [Array.from(times, (time) => time - atS), ...columns];
}

function thinned(times: number[], values: (number | null)[], most: number): uPlot.AlignedData {
  const size = Math.ceil((2 * times.length) / most);
  if (size <= 2) return [times, values];
  const kept: number[] = [];
  for (let begin = 0; begin < times.length; begin += size) {
    let [low, high] = [begin, begin];
    for (let i = begin; i < Math.min(begin + size, times.length); i++) {
      const value = values[i] ?? null;
      if (value !== null && value < (values[low] ?? Infinity)) low = i;
      if (value !== null && value > (values[high] ?? -Infinity)) high = i;
    }
    kept.push(Math.min(low, high), ...(low === high ? [] : [Math.max(low, high)]));
  }
  return [kept.map((i) => times[i] as number), kept.map((i) => values[i] ?? null)];
}

/** Comma-separated values (RFC 4180) of all that is kept of the fields. */
export function csv(fields: readonly string[]): string {
  const [times, ...columns] = rows(fields, -Infinity, Infinity);
  const lines = [...times].map((time, i) => [time.toFixed(6), ...columns.map((column) => column[i] ?? "")].join(","));
  return [["robot_s", ...fields].join(","), ...lines, ""].join("\r\n");
}
