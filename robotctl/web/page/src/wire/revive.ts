// Makes objects of structs that arrive as arrays.

import { SHAPES } from "./messages";

/** The value of a struct `name`, with all structs within it as objects. */
export function revive(name: string, value: unknown): unknown {
  const shape = SHAPES[name];
  if (shape === undefined || value === null) return value;
  const { fields, nested = {} } = shape;
  const found = fields === undefined ? (value as Record<string, unknown>) : named(fields, value as unknown[]);
  for (const [field, inner] of Object.entries(nested)) {
    found[field] = inner.endsWith("[]")
      ? (found[field] as unknown[]).map((each) => revive(inner.slice(0, -2), each))
      : revive(inner, found[field]);
  }
  return found;
}

function named(fields: readonly string[], values: readonly unknown[]): Record<string, unknown> {
  return Object.fromEntries(fields.map((field, i) => [field, values[i]]));
}
