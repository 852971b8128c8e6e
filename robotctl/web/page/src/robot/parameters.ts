// The robot's parameters, and how to undo what was changed while this page looked.

import { computed, signal } from "@preact/signals";

import type { ParameterFacts, ParameterTable, ParameterValues } from "../wire/messages";

export interface Parameter extends ParameterFacts {
  /** Value that was set; false and true are 0 and 1. */
  readonly wanted: number;
  /** Value in force; a restart brings the wanted one. */
  readonly inForce: number;
  /** Value of the robot's file. */
  readonly standard: number;
  readonly isBool: boolean;
}

interface Change {
  readonly name: string;
  readonly from: number;
  readonly to: number;
}

const table = signal<readonly ParameterFacts[]>([]);
const values = signal<ParameterValues | null>(null);
/** Changes by anybody since the page began to look, the newest last. */
const changes = signal<readonly Change[]>([]);
let undoing: Change | null = null;

export const parameters = computed<readonly Parameter[]>(() => {
  const { wanted = [], in_force = [] } = values.value ?? {};
  if (wanted.length !== table.value.length) return [];
  return table.value.map((facts, i) => ({
    ...facts,
    wanted: Number(wanted[i]),
    inForce: Number(in_force[i]),
    standard: Number(facts.default),
    isBool: typeof facts.default === "boolean",
  }));
});
export const changed = computed(() => parameters.value.filter((each) => each.wanted !== each.standard));
/** The change that `undo` takes back; null: none. */
export const lastChange = computed(() => changes.value.at(-1) ?? null);

export function describe(message: ParameterTable): void {
  const isOther = table.peek().some(({ name }, i) => name !== message.parameters[i]?.name);
  if (isOther) changes.value = []; // another robot's
  table.value = message.parameters;
}

export function takeValues(message: ParameterValues): void {
  const before = parameters.peek();
  values.value = message;
  if (before.length === 0) return;
  const found = parameters
    .peek()
    .map(({ name, wanted }, i) => ({ name, from: (before[i] as Parameter).wanted, to: wanted }))
    .filter(({ from, to }) => from !== to);
  for (const change of found) note(change);
}

/** Keep a change, or forget the one that it takes back. */
function note(change: Change): void {
  const last = changes.peek().at(-1);
  const isUndone = last !== undefined && last === undoing && change.name === last.name && change.to === last.from;
  changes.value = isUndone ? changes.peek().slice(0, -1) : [...changes.peek(), change];
}

/** The value that undoes the last change; null: there is none. */
export function undo(): { readonly name: string; readonly value: number } | null {
  undoing = changes.peek().at(-1) ?? null;
  return undoing && { name: undoing.name, value: undoing.from };
}

export function parameter(name: string): Parameter | undefined {
  return parameters.value.find((each) => each.name === name);
}

/** A number as people write it: seven digits tell all 32 bit numbers apart that people mean. */
export function shown(value: number): string {
  return String(Number(value.toPrecision(7)));
}
