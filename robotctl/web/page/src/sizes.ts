// Amounts of data for people.

const UNITS = ["B", "kB", "MB", "GB", "TB"] as const;

/** Bytes for people. */
export function size(bytes: number): string {
  const step = Math.min(Math.floor(Math.log10(Math.max(bytes, 1)) / 3), UNITS.length - 1);
  return `${(bytes / 1000 ** step).toFixed(step > 1 ? 1 : 0)} ${UNITS[step] ?? ""}`;
}
