// Two recordings beside each other: a page for each, and one bar.

import { useEffect, useState } from "preact/hooks";

import { decode } from "../wire/msgpack";
import type { History } from "../wire/messages";
import { words } from "../words";
import { ReplayBar } from "./bar";
import { runs } from "./mode";

const NUMBERS = Array.from({ length: runs }, (_, i) => i);

export function Compare() {
  const [histories, setHistories] = useState<readonly (History | null)[]>(NUMBERS.map(() => null));
  useEffect(() => {
    void Promise.all(NUMBERS.map(fetchHistory)).then(setHistories);
  }, []);
  return (
    <>
      <div class="compare">
        {NUMBERS.map((run) => (
          <iframe key={run} src={`/?run=${run}`} title={words.replay.run(run + 1)} />
        ))}
      </div>
      <ReplayBar histories={histories} />
    </>
  );
}

async function fetchHistory(run: number): Promise<History | null> {
  const answer = await fetch(`/history?run=${run}`);
  return answer.ok ? (decode(new Uint8Array(await answer.arrayBuffer())) as History) : null;
}
