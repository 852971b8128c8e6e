// Plans go by POST: a mission may be longer than any message of the socket.

import { signal } from "@preact/signals";

import { hello } from "../robot/robot";
import { refusal, stampRequest } from "../wire/live";
import { words } from "../words";

type Body =
  | { readonly type: "MissionUpload"; readonly text: string }
  | { readonly type: "FenceUpload"; readonly polygons: unknown; readonly circles: unknown }
  | { readonly type: "ZonesUpload"; readonly zones: unknown };

/** What is on its way to the robot: `crc` by which it is known once it has arrived. */
export const sentMission = signal<{ readonly crc: number } | null>(null);

/** Hand a plan to the robot; return its CRC-32, or null where the refusal is said. */
export async function sendPlan(what: string, body: Body): Promise<number | null> {
  refusal.value = null;
  const stamped = stampRequest(what);
  if (stamped === null) return null;
  const answer = await post("/plans", JSON.stringify({ ...body, ...stamped, client: hello.peek()?.client ?? 0 }));
  if (answer.ok) return (JSON.parse(answer.text) as { crc: number }).crc;
  refusal.value = { what, reason: answer.text };
  return null;
}

/** The tables of a mission's file; null: it is none, which is said. */
export async function readToml<T>(what: string, file: Blob | Uint8Array | string): Promise<T | null> {
  const answer = await post("/toml", file as BodyInit);
  if (answer.ok) return JSON.parse(answer.text) as T;
  refusal.value = { what, reason: answer.text };
  return null;
}

async function post(path: string, body: BodyInit): Promise<{ readonly ok: boolean; readonly text: string }> {
  try {
    const answer = await fetch(path, { method: "POST", body });
    return { ok: answer.ok, text: await answer.text() };
  } catch {
    return { ok: false, text: words.refusals.unsent };
  }
}
