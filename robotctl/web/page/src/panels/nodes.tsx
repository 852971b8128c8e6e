// The nodes on the robot's bus.

import { topics } from "../robot/robot";
import { words } from "../words";

const text = words.nodes;

/** NMT states of CiA 301. */
const NMT_STATES: Readonly<Record<number, string>> = {
  0: "boot-up",
  4: "stopped",
  5: "operational",
  127: "pre-operational",
};

export function Nodes() {
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
