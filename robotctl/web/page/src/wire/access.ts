// Whether this page may talk to the robot: the token of the link becomes a cookie, and leaves the address bar.

import { signal } from "@preact/signals";

const RETRY_MS = 1000;

/** false: the server asks for a token that this browser does not have. */
export const access = signal(true);

/** Trade the token of the address, if there is one, for a session; call this before any connection. */
export async function openSession(): Promise<void> {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (token === null) return;
  history.replaceState(null, "", location.pathname + location.search);
  for (;;) {
    try {
      access.value = (await post(token)).ok;
      return;
    } catch {
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS)); // nobody is there: the token must not be lost
    }
  }
}

function post(token: string): Promise<Response> {
  return fetch("/session", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ token }),
  });
}

/** Ask why a connection was refused: a browser does not tell. */
export async function checkAccess(): Promise<void> {
  try {
    access.value = (await fetch("/session")).status !== 403;
  } catch {
    access.value = true; // nobody is there: that is another trouble
  }
}
