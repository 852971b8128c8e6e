// Which axis and button of a gamepad does what; kept by the browser.

import { signal } from "@preact/signals";

import { keep, kept } from "../kept";

export type AxisAction = "forward" | "turn" | "sideways";
export type ButtonAction = "deadMan" | "stop" | "arm" | "disarm" | "hold" | "auto";
export type PadAction = AxisAction | ButtonAction;

export interface AxisBinding {
  readonly axis: number;
  readonly sign: 1 | -1;
}

export interface PadMapping {
  readonly axes: Readonly<Record<AxisAction, AxisBinding>>;
  readonly buttons: Readonly<Record<ButtonAction, number>>;
}

/** For pads of the standard layout (W3C Gamepad, section 7): left stick, right stick, shoulder, A B X Y. */
export const STANDARD: PadMapping = {
  axes: {
    forward: { axis: 1, sign: -1 },
    turn: { axis: 2, sign: -1 },
    sideways: { axis: 0, sign: -1 },
  },
  buttons: { deadMan: 5, stop: 1, arm: 9, disarm: 8, hold: 0, auto: 3 },
};

const KEY = "pad";

export const mapping = signal<PadMapping>(kept(KEY, STANDARD));

export function setAxis(action: AxisAction, binding: AxisBinding): void {
  change({ ...mapping.value, axes: { ...mapping.value.axes, [action]: binding } });
}

export function setButton(action: ButtonAction, button: number): void {
  change({ ...mapping.value, buttons: { ...mapping.value.buttons, [action]: button } });
}

export function resetMapping(): void {
  change(STANDARD);
}

function change(wanted: PadMapping): void {
  mapping.value = wanted;
  keep(KEY, wanted);
}
