"""A member of a bus as the host reports it: heard or not, how often it came, and its problem."""

from __future__ import annotations

from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import Fault, FaultCode


class Presence:
    """Base of what follows one member of a bus.

    Parameters
    ----------
    node_id, name
        Number and name of it.
    nmt_state
        State to report before it is heard.
    fault
        Why it is not in service.

    Attributes
    ----------
    node_id, name
        Number and name of it.
    nmt_state
        State to report, as CANopen numbers them.
    heard_ns
        When it was last heard [ns].
    boots
        How often it came, the first time included.
    fault
        Why it is not in service; None if it is.
    status
        Present state; another object only where it changed.
    """

    __slots__ = ("boots", "fault", "heard_ns", "name", "nmt_state", "node_id", "status")

    def __init__(self, node_id: int, name: str, nmt_state: int, fault: Fault) -> None:
        self.node_id = node_id
        self.name = name
        self.nmt_state = nmt_state
        self.heard_ns = 0
        self.boots = 0
        self.fault: Fault | None = fault
        self.status: NodeStatus

    def _say(self, fault: Fault | None) -> None:
        """Set the problem."""
        self.fault = fault
        self._refresh()

    def _refresh(self) -> None:
        """Update `status`."""
        fault = self.fault
        self.status = NodeStatus(
            self.node_id,
            self.name,
            self.nmt_state,
            self.heard_ns,
            self.boots,
            f"{self.name} (node {self.node_id}): {fault}" if fault else "",
            fault.code if fault else FaultCode.NONE,
        )
