"""Reports of nodes besides feedback: restarts and errors."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final, NamedTuple

from robotctl.messages.control import EmergencyMessage, Feedback, NodeStatus, Notice, Severity
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.emergency_codes import emergency_words

_NO_ERROR: Final = 0
"""EMCY code of a node whose errors are over (CiA 301, 7.2.7)."""

_NOT_IN_THE_POSE: Final = (
    "the drive restarted or was silent: its motion meanwhile is not in the pose"
)


class Events(NamedTuple):
    """New events."""

    drive_booted: bool
    """The counts of the drive restart."""
    restarts: tuple[Fault, ...]
    """Nodes that had been up before, as reasons to stop."""
    notices: tuple[Notice, ...]


class NodeEvents:
    """Detects changes in the nodes' reports.

    Parameters
    ----------
    drives
        Names of the motor drives.
    """

    def __init__(self, drives: Collection[str]) -> None:
        self._drives = frozenset(drives)
        self._nodes: tuple[NodeStatus, ...] = ()
        self._boots: dict[str, int] = {}
        self._told: set[tuple[int, int]] = set()

    def take(self, feedback: Feedback, now_ns: int) -> Events | None:
        """Return the events since the last call; None in most periods."""
        nodes = feedback.nodes
        if nodes is self._nodes and not feedback.emergencies:
            return None
        booted = [] if nodes is self._nodes else self._booted(nodes)
        restarted = [(node, before) for node, before in booted if before is not None]
        texts = [self._error(emergency) for emergency in feedback.emergencies]
        if any(node.name in self._drives for node, _ in restarted):
            texts.insert(0, _NOT_IN_THE_POSE)
        return Events(
            any(node.name in self._drives for node, _ in booted),
            tuple(_restart(node, before) for node, before in restarted),
            tuple(Notice(now_ns, Severity.WARNING, text) for text in texts if text),
        )

    def forget_errors(self) -> None:
        """Let each error be reported again."""
        self._told.clear()

    def _booted(self, nodes: tuple[NodeStatus, ...]) -> list[tuple[NodeStatus, NodeStatus | None]]:
        """Return the nodes that have booted since last asked, as they are and as they were.

        None for a node that is there for the first time.
        """
        before = {node.name: node for node in self._nodes if node.boots}
        self._nodes = nodes
        booted = []
        for node in nodes:
            if self._boots.get(node.name) != node.boots:
                self._boots[node.name] = node.boots
                booted.append((node, before.get(node.name)))
        return booted

    def _error(self, emergency: EmergencyMessage) -> str:
        """Return the text of an EMCY message; empty: none, or already reported."""
        number, code = emergency.node_id, emergency.code
        if code == _NO_ERROR or (number, code) in self._told:
            return ""
        self._told.add((number, code))
        name = next((node.name for node in self._nodes if node.node_id == number), "unknown")
        return f"{name} (node {number}) reports error 0x{code:04X}: {emergency_words(code)}"


def _restart(node: NodeStatus, before: NodeStatus) -> Fault:
    name = f"{node.name} (node {node.node_id})"
    if before.fault is FaultCode.NODE_SILENT:
        text = f"{name} was silent and is back: it restarted, or was cut off"
        return Fault(FaultCode.NODE_SILENT, text, node.name)
    return Fault(FaultCode.NODE_RESTARTED, f"{name} restarted", node.name)
