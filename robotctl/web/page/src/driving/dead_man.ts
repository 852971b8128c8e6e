// Who of the input devices drives, and whether anybody does: the dead man's handle.
//
// Driving begins with a fresh edge: after each interruption a key that is held does not count until
// it was let go once. A device that gives the same sample on and on while its sticks are off centre
// is taken for dead: a radio that drops out repeats the last sample for ever.

import { isCentred, RELEASED, type Deflection, type Reading, type SourceName } from "./source";

export const FROZEN_MS = 200;

export interface Decision extends Deflection {
  readonly held: boolean;
  /** The device that drives; null: none. */
  readonly source: SourceName | null;
  /** Grows with each live sample of that device. */
  readonly sample: number;
  /** When that sample was taken [ms]. */
  readonly takenMs: number;
}

export type Interruption = "hidden" | "blur" | "closed" | "stale" | "driver" | "frozen";

export class DeadMan {
  /** Why driving was interrupted last, until it begins again. */
  interruption: Interruption | null = null;
  private released = new Set<SourceName>();
  private active: SourceName | null = null;
  private sampledMs = -Infinity;
  private sample = 0;

  /** Let go, whatever is held. */
  interrupt(why: Interruption): void {
    if (this.active !== null) this.interruption = why;
    this.active = null;
    this.released.clear();
  }

  /** Decide by what all devices say now. */
  step(readings: ReadonlyMap<SourceName, Reading>, nowMs: number): Decision {
    for (const [name, reading] of readings) {
      if (!reading.held) this.released.add(name);
    }
    if (this.active !== null && readings.get(this.active)?.held !== true) this.active = null;
    this.active ??= this.begin(readings);
    const driving = this.active === null ? undefined : readings.get(this.active);
    if (driving === undefined) return this.idle(nowMs);

    if (isCentred(driving)) {
      this.sampledMs = nowMs; // sticks at rest give no samples, and do no harm
      this.sample++;
    } else if (nowMs - driving.sampledMs > FROZEN_MS) {
      this.interrupt("frozen");
      return this.idle(nowMs);
    } else if (driving.sampledMs > this.sampledMs) {
      this.sampledMs = driving.sampledMs;
      this.sample++;
    }
    const { forward, turn, sideways } = driving;
    return { held: true, source: this.active, sample: this.sample, takenMs: this.sampledMs, forward, turn, sideways };
  }

  /** The device whose key was just pressed; null: none. The one that drives already is never displaced. */
  private begin(readings: ReadonlyMap<SourceName, Reading>): SourceName | null {
    for (const [name, reading] of readings) {
      if (reading.held && this.released.delete(name)) {
        this.interruption = null;
        this.sampledMs = -Infinity;
        return name;
      }
    }
    return null;
  }

  private idle(nowMs: number): Decision {
    return { held: false, source: null, sample: ++this.sample, takenMs: nowMs, ...RELEASED };
  }
}
