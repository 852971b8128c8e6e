// Rise time, overshoot and steady error of a step of the wheels' speeds.

import type { Response } from "../wire/messages";

/** Speeds of one wheel, and their times from the step on [s]. */
export interface Course {
  readonly timesS: readonly number[];
  readonly wanted: readonly number[];
  readonly measured: readonly number[];
}

export interface Figures {
  /** Time from a tenth to nine tenths of the step [s]; null: it did not get there. */
  readonly riseS: number | null;
  /** The same of the set-point, which the robot's limits hold back [s]. */
  readonly wantedRiseS: number | null;
  /** Greatest speed beyond that of the step, as a share of it. */
  readonly overshoot: number;
  /** Mean of set-point less measured speed over the last quarter [rad/s]. */
  readonly steadyError: number;
}

const BEFORE_S = 0.1;
const STEADY_SHARE = 0.25;

/** The wheels' courses from just before the last step up to where its set-point goes down; none: nothing moved. */
export function coursesOf({ stamp_ns, wheel_ref_rad_s, wheel_rad_s }: Response): Course[] {
  const moves = wheel_ref_rad_s.map((speeds) => speeds.some((each) => each !== 0));
  const end = moves.lastIndexOf(true);
  if (end < 0) return [];
  const begin = moves.lastIndexOf(false, end) + 1;
  const peaks = (wheel_ref_rad_s[end] as readonly number[]).map((_, wheel) =>
    Math.max(...wheel_ref_rad_s.slice(begin, end + 1).map((speeds) => Math.abs(speeds[wheel] as number))),
  );
  // The set-point goes down where it leaves its greatest value for the last time.
  let top = end;
  while (top > begin && peaks.some((peak, wheel) => Math.abs(at(wheel_ref_rad_s, top, wheel)) < 0.999 * peak)) top--;
  const beginNs = stamp_ns[begin] as number;
  const first = stamp_ns.findIndex((each) => each >= beginNs - BEFORE_S * 1e9);
  const rows = [...stamp_ns.keys()].slice(first, top + 1);
  return peaks.map((_, wheel) => ({
    timesS: rows.map((row) => ((stamp_ns[row] as number) - beginNs) / 1e9),
    wanted: rows.map((row) => at(wheel_ref_rad_s, row, wheel)),
    measured: rows.map((row) => at(wheel_rad_s, row, wheel)),
  }));
}

function at(rows: readonly (readonly number[])[], row: number, wheel: number): number {
  return rows[row]?.[wheel] ?? NaN;
}

export function figuresOf({ timesS, wanted, measured }: Course): Figures {
  const final = wanted.at(-1) as number;
  const shares = measured.map((each) => each / final);
  const steady = Math.floor((1 - STEADY_SHARE) * timesS.length);
  const errors = wanted.slice(steady).map((each, i) => each - (measured[steady + i] as number));
  return {
    riseS: riseOf(timesS, shares),
    wantedRiseS: riseOf(
      timesS,
      wanted.map((each) => each / final),
    ),
    overshoot: Math.max(0, Math.max(...shares) - 1),
    steadyError: errors.reduce((sum, each) => sum + each, 0) / errors.length,
  };
}

function riseOf(timesS: readonly number[], shares: readonly number[]): number | null {
  const begin = crossing(timesS, shares, 0.1);
  const end = crossing(timesS, shares, 0.9);
  return begin === null || end === null ? null : end - begin;
}

/** Time at which the shares first reach a level, between two samples by the line through them. */
function crossing(timesS: readonly number[], shares: readonly number[], level: number): number | null {
  const i = shares.findIndex((each) => each >= level);
  if (i < 0) return null;
  const [t1, s1] = [timesS[i] as number, shares[i] as number];
  const [t0, s0] = [timesS[i - 1] ?? t1, shares[i - 1] ?? s1];
  return s1 === s0 ? t1 : t0 + ((level - s0) / (s1 - s0)) * (t1 - t0);
}
