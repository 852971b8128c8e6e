"""What the nodes tell of themselves beside their feedback: restarts and errors."""

from __future__ import annotations

from typing import Final

from robotctl.messages.control import EmergencyMessage, Feedback, NodeStatus
from robotctl.safety.emergency_codes import emergency_words

_NO_ERROR: Final = 0
"""EMCY code of a node whose errors are over (CiA 301, 7.2.7)."""


class NodeEvents:
    """Finds what is new in what the nodes report."""

    def __init__(self) -> None:
        self._nodes: tuple[NodeStatus, ...] = ()
        self._boots: dict[int, int] = {}
        self._told: set[tuple[int, int]] = set()

    def booted(self, feedback: Feedback) -> list[tuple[NodeStatus, bool]]:
        """Return the nodes that have booted since last asked; whether they had been up before."""
        if feedback.nodes is self._nodes:  # in most periods
            return []
        self._nodes = feedback.nodes
        booted = []
        for node in feedback.nodes:
            before = self._boots.get(node.node_id)
            if before != node.boots:
                self._boots[node.node_id] = node.boots
                booted.append((node, bool(before)))
        return booted

    def error(self, emergency: EmergencyMessage) -> str:
        """Return what to tell people of an EMCY message; empty: nothing, or told already."""
        number, code = emergency.node_id, emergency.code
        if code == _NO_ERROR or (number, code) in self._told:
            return ""
        self._told.add((number, code))
        name = next((node.name for node in self._nodes if node.node_id == number), "unknown")
        return f"{name} (node {number}) reports error 0x{code:04X}: {emergency_words(code)}"

    def forget_errors(self) -> None:
        """Let each error be told once more."""
        self._told.clear()
