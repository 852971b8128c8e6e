// The nodes on the robot's bus, and its computer.

import { computer, topics } from "../robot/robot";
import { size } from "../sizes";
import { words } from "../words";

const text = words.nodes;

/** NMT states of CiA 301. */
const NMT_STATES: Readonly<Record<number, string>> = {
  0: "boot-up",
  4: "stopped",
  5: "operational",
  127: "pre-operational",
};

const BUSY = 0.9;
const HOT_C = 80;
const LITTLE_MEMORY = 0.05;
const LITTLE_DISK = 500e6;

export function Nodes() {
  return (
    <>
      <Computer />
      <NodeTable />
      <StepTimes />
    </>
  );
}

function Computer() {
  const now = computer.value;
  if (now === null) return null;
  const figures: readonly (readonly [string, string | null, boolean])[] = [
    [text.processor, now.processor === null ? null : text.percent(now.processor), (now.processor ?? 0) > BUSY],
    [text.temperature, now.temperature_c === null ? null : text.celsius(now.temperature_c), (now.temperature_c ?? 0) > HOT_C],
    [text.memory, text.left(size(now.memory_free)), now.memory_free < LITTLE_MEMORY * now.memory],
    [text.disk, now.disk_free === null ? null : text.left(size(now.disk_free)), (now.disk_free ?? Infinity) < LITTLE_DISK],
  ];
  return (
    <dl class="figures computer" aria-label={text.computer}>
      {figures.map(([name, value, isBad]) => (
        <div key={name} class={isBad ? "figure bad" : "figure"}>
          <dt>{name}</dt>
          <dd>
            {isBad && <span aria-hidden="true">⚠ </span>}
            {value ?? words.unknown}
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** How long navigation's steps take, by part. */
function StepTimes() {
  const budget = topics.NavigationState.newest.value?.budget;
  if (budget === undefined || budget.steps === 0) return null;
  const parts = Object.keys(budget.parts_p50_ms);
  return (
    <table class={budget.p99_ms > budget.period_ms ? "nodes bad" : "nodes"}>
      <caption>{text.steps(budget.period_ms, budget.late, budget.steps)}</caption>
      <thead>
        <tr>
          <th scope="col">{text.part}</th>
          <th scope="col">{text.median}</th>
          <th scope="col">{text.high}</th>
        </tr>
      </thead>
      <tbody>
        <Times part={text.inAll} p50_ms={budget.p50_ms} p99_ms={budget.p99_ms} />
        {parts.map((part) => (
          <Times key={part} part={part} p50_ms={budget.parts_p50_ms[part]} p99_ms={budget.parts_p99_ms[part]} />
        ))}
      </tbody>
    </table>
  );
}

function Times({ part, p50_ms = 0, p99_ms = 0 }: { part: string; p50_ms?: number | undefined; p99_ms?: number | undefined }) {
  return (
    <tr>
      <th scope="row">{part}</th>
      <td>{p50_ms.toFixed(1)}</td>
      <td>{p99_ms.toFixed(1)}</td>
    </tr>
  );
}

function NodeTable() {
  const nodes = topics.ControlState.newest.value?.nodes ?? [];
  if (nodes.length === 0) return <p class="empty">{text.none}</p>;
  return (
    <table class="nodes">
      <thead>
        <tr>
          <th scope="col">{text.name}</th>
          <th scope="col">{text.state}</th>
          <th scope="col">{text.boots}</th>
          <th scope="col">{text.problem}</th>
        </tr>
      </thead>
      <tbody>
        {nodes.map((node) => (
          <tr key={node.node_id} class={node.problem === "" ? "" : "bad"}>
            <th scope="row">
              {node.name} <small>{node.node_id}</small>
            </th>
            <td>{NMT_STATES[node.nmt_state] ?? node.nmt_state}</td>
            <td>{node.boots}</td>
            <td>{node.problem || text.fine}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
