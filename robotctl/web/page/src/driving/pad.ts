// Driving by gamepad.

import { signal } from "@preact/signals";

import {
  mapping,
  setAxis,
  setButton,
  type AxisAction,
  type ButtonAction,
  type PadAction,
} from "./pad_mapping";
import { RELEASED, type Reading } from "./source";

const DEAD_ZONE = 0.12;
/** Deflection by which a stick is meant, when it is asked for [share]. */
const CHOSEN = 0.6;

export const AXES: readonly AxisAction[] = ["forward", "turn", "sideways"];
export const BUTTONS: readonly ButtonAction[] = ["deadMan", "stop", "arm", "disarm", "hold", "auto"];

/** Name of the gamepad in use; null: there is none. */
export const padName = signal<string | null>(null);
/** What the next stick or button that moves will do; null: nothing is being asked for. */
export const learning = signal<PadAction | null>(null);

export class Pad {
  private pressed = new Set<number>();
  /** Axes at rest, for the one that is to be learnt: triggers of some pads rest at -1. */
  private rest: readonly number[] = [];

  constructor(private readonly onButton: (action: ButtonAction) => void) {}

  /** Read the first pad that is there, and act on buttons that were just pressed. */
  read(): Reading {
    const pad = navigator.getGamepads().find((each) => each?.connected) ?? null;
    padName.value = pad?.id ?? null;
    if (pad === null) {
      this.pressed.clear();
      return { held: false, sampledMs: -Infinity, ...RELEASED };
    }
    if (learning.peek() !== null) {
      this.learn(pad, learning.peek() as PadAction);
      return { held: false, sampledMs: pad.timestamp, ...RELEASED };
    }
    this.rest = pad.axes;
    this.press(pad);
    return {
      held: this.isPressed(pad, "deadMan"),
      sampledMs: pad.timestamp,
      forward: deflection(pad, "forward"),
      turn: deflection(pad, "turn"),
      sideways: deflection(pad, "sideways"),
    };
  }

  private isPressed(pad: Gamepad, action: ButtonAction): boolean {
    return pad.buttons[mapping.peek().buttons[action]]?.pressed === true;
  }

  private press(pad: Gamepad): void {
    for (const action of BUTTONS) {
      const button = mapping.peek().buttons[action];
      const before = this.pressed.has(button);
      if (this.isPressed(pad, action) && !before && action !== "deadMan") this.onButton(action);
    }
    this.pressed = new Set(pad.buttons.flatMap((button, i) => (button.pressed ? [i] : [])));
  }

  private learn(pad: Gamepad, action: PadAction): void {
    if (isAxis(action)) {
      const axis = pad.axes.findIndex((value, i) => Math.abs(value - (this.rest[i] ?? 0)) > CHOSEN);
      if (axis < 0) return;
      setAxis(action, { axis, sign: (pad.axes[axis] ?? 0) > (this.rest[axis] ?? 0) ? 1 : -1 });
    } else {
      const button = pad.buttons.findIndex((each, i) => each.pressed && !this.pressed.has(i));
      if (button < 0) return;
      setButton(action, button);
      this.pressed.add(button);
    }
    learning.value = null;
  }
}

export function isAxis(action: PadAction): action is AxisAction {
  return (AXES as readonly PadAction[]).includes(action);
}

/** Deflection beyond the dead zone, where it begins with 0. */
function deflection(pad: Gamepad, action: AxisAction): number {
  const { axis, sign } = mapping.peek().axes[action];
  const value = sign * (pad.axes[axis] ?? 0);
  const beyond = Math.max(0, Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE);
  return Math.sign(value) * Math.min(1, beyond);
}
