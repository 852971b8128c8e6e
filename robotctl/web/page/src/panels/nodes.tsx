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
