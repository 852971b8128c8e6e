// What can drive the robot: a keyboard, a finger, a gamepad.

/** Sticks in [-1, 1]: forward, turn and sideways, both to the left. */
export interface Deflection {
  readonly forward: number;
  readonly turn: number;
  readonly sideways: number;
}

/** State of an input device. */
export interface Reading extends Deflection {
  /** Whether the dead-man key is held. */
  readonly held: boolean;
  /** Time of the device's sample, of the page's clock [ms]. One that stands still is of a dead device. */
  readonly sampledMs: number;
}

export type SourceName = "keyboard" | "touch" | "pad" | "step";

export const RELEASED: Deflection = { forward: 0, turn: 0, sideways: 0 };

export function isCentred(sticks: Deflection): boolean {
  return sticks.forward === 0 && sticks.turn === 0 && sticks.sideways === 0;
}
