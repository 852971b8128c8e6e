// Changed parameters as lines of the robot's file.

import { shown, type Parameter } from "../robot/parameters";

/** The tables and keys of some parameters, as TOML. */
export function patchOf(changed: readonly Parameter[]): string {
  const tables = new Map<string, string[]>();
  for (const each of changed) {
    const dot = each.key.lastIndexOf(".");
    const table = each.key.slice(0, dot);
    const line = `${each.key.slice(dot + 1)} = ${literal(each)}`;
    tables.set(table, [...(tables.get(table) ?? []), line]);
  }
  return [...tables].map(([table, lines]) => `[${table}]\n${lines.join("\n")}\n`).join("\n");
}

function literal({ isBool, is_whole, wanted }: Parameter): string {
  if (isBool) return wanted === 0 ? "false" : "true";
  const text = shown(wanted);
  return is_whole || /[.e]/.test(text) ? text : `${text}.0`;
}
