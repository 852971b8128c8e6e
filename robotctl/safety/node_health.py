"""The nodes on the bus as control sees them: which are missing, silent or out of service."""

from __future__ import annotations

from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.ages import fresh_span_ns, is_fresh


class NodeHealth:
    """Keeps the nodes' newest state and judges it.

    Parameters
    ----------
    limit_ns
        Maximum age of a node's heartbeat [ns].

    Attributes
    ----------
    nodes
        Newest state of each.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self.update(())

    def update(self, nodes: tuple[NodeStatus, ...]) -> None:
        """Store the nodes' state, which changes only with their heartbeats."""
        self.nodes = nodes
        heartbeats_ns = [node.heartbeat_ns for node in nodes]
        self._fresh_ns = fresh_span_ns(heartbeats_ns, self._limit_ns)
        # There are some, and none has a problem but perhaps its age.
        self._in_service = bool(nodes) and not any(node.problem for node in nodes)

    def faults(self, now_ns: int) -> list[Fault]:
        """Return the faults that keep nodes out of service."""
        limit_ns, (first_ns, last_ns) = self._limit_ns, self._fresh_ns
        if self._in_service and first_ns <= now_ns <= last_ns:
            return []
        faults = []
        if not self.nodes:
            text = "no heartbeat from any node on the bus"
            faults.append(Fault(FaultCode.NODE_NOT_HEARD, text))
        for node in self.nodes:
            if node.problem:
                faults.append(Fault(node.fault, node.problem, node.name))
            elif not is_fresh(node.heartbeat_ns, now_ns, limit_ns):
                silence = f"no heartbeat for {limit_ns / 1e6:g} ms"
                text = f"{node.name} (node {node.node_id}): {silence}"
                faults.append(Fault(FaultCode.NODE_SILENT, text, node.name))
        return faults
