// The chosen fields on one axis of time.

import uPlot from "uplot";

import { series } from "./history";

/** Times [s] and a column a field, from `sinceS` seconds before the newest on; null where a field has no value. */
export function rows(fields: readonly string[], sinceS: number): uPlot.AlignedData {
  const all = fields.map(series);
  const newest = Math.max(...all.map(([times]) => times.at(-1) ?? -Infinity));
  const tables = all.map(([times, values]): uPlot.AlignedData => {
    const begin = firstAfter(times, newest - sinceS);
    return [times.slice(begin), values.slice(begin)];
  });
  const [first] = tables;
  if (first === undefined) return [[]];
  const isOneTopic = all.every(([times]) => times === all[0]?.[0]);
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

/** The same with times before the newest, for a chart that stands still while time goes on. */
export function recent(fields: readonly string[], sinceS: number): uPlot.AlignedData {
  const [times, ...columns] = rows(fields, sinceS);
  const newest = times.at(-1) ?? 0;
  return [Array.from(times, (time) => time - newest), ...columns];
}

/** Comma-separated values (RFC 4180) of all that is kept of the fields. */
export function csv(fields: readonly string[]): string {
  const [times, ...columns] = rows(fields, Infinity);
  const lines = [...times].map((time, i) => [time.toFixed(6), ...columns.map((column) => column[i] ?? "")].join(","));
  return [["robot_s", ...fields].join(","), ...lines, ""].join("\r\n");
}
