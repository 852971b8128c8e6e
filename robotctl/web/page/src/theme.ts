// Light or dark: as the system has it, until somebody chooses.

import { effect, signal } from "@preact/signals";

import { keep, kept } from "./kept";

export type Theme = "light" | "dark";

const KEY = "theme";
const system = matchMedia("(prefers-color-scheme: dark)");
const chosen = signal<Theme | null>(kept<Theme | null>(KEY, null));

export const theme = signal<Theme>("light");

export function startTheme(): void {
  const apply = () => {
    const wanted = chosen.value ?? (system.matches ? "dark" : "light");
    document.documentElement.dataset["theme"] = wanted;
    theme.value = wanted;
  };
  effect(apply);
  system.addEventListener("change", apply);
}

export function toggleTheme(): void {
  chosen.value = theme.value === "dark" ? "light" : "dark";
  keep(KEY, chosen.value);
}
