// Whether this page may talk to the robot: the token of the link becomes a cookie, and leaves the address bar.

import { signal } from "@preact/signals";

/** false: the server asks for a token that this browser does not have. */
export const access = signal(true);

/** Trade the token of the address, if there is one, for a session; call this before any connection. */
export async function openSession(): Promise<void> {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (token === null) return;
  history.replaceState(null, "", location.pathname + location.search);
  const answer = await fetch("/session", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ token }),
  });
  access.value = answer.ok;
}

/** Ask why a connection was refused: a browser does not tell. */
export async function checkAccess(): Promise<void> {
  try {
    access.value = (await fetch("/session")).status !== 403;
  } catch {
    access.value = true; // nobody is there: that is another trouble
  }
}
