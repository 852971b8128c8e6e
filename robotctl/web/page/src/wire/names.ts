/** Name of a value of an enumeration; null: another version of robotctl has it. */
export function nameOf<T extends Readonly<Record<string, number>>>(kind: T, value: number): keyof T | null {
  return Object.keys(kind).find((name) => kind[name] === value) ?? null;
}
