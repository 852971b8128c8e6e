// Settings of the page that the browser keeps.

const PREFIX = "robotctl.";

/** A kept value; the default where there is none, or the browser keeps nothing. */
export function kept<T>(key: string, standard: T): T {
  try {
    const found = localStorage.getItem(PREFIX + key);
    return found === null ? standard : (JSON.parse(found) as T);
  } catch {
    return standard;
  }
}

export function keep(key: string, value: unknown): void {
  try {
    localStorage.setItem(PREFIX + key, JSON.stringify(value));
  } catch {
    // A private window may refuse; the setting then lasts as long as the page.
  }
}
