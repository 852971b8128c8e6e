"""A CANopen node as a part of its bus: its services, its emergencies, foreign NMT commands."""

from __future__ import annotations

from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.nodes.identifiers import CobId
from robotctl.drivers.can.nodes.node import Node
from robotctl.messages.control import EmergencyMessage, NodeStatus


class NodePart:
    """Base of the parts that are a node of CANopen.

    Parameters
    ----------
    node
        State machine of the node.
    notes
        Notes about its bus.

    Attributes
    ----------
    node
        State machine of the node.
    handlers
        Frames that it listens to.
    emergency_code
        Error code of its last emergency message; 0 before one.
    """

    def __init__(self, node: Node, notes: BusNotes) -> None:
        self.node = node
        self.emergency_code = 0
        self._notes = notes
        node_id = node.node_id
        self.handlers: dict[int, Handler] = {
            CobId.NMT: self._on_foreign_nmt,
            CobId.HEARTBEAT + node_id: node.on_heartbeat,
            CobId.SDO_REQUEST + node_id: node.on_foreign_sdo,
            CobId.SDO_RESPONSE + node_id: lambda data, _: node.on_sdo(data),
            CobId.EMERGENCY + node_id: self._on_emergency,
        }

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not."""
        return self.node.status

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send the next frame of its node services; return whether there was one."""
        node = self.node
        if not node.busy:
            return False
        frame = node.poll(now_ns)
        if frame is None:
            return False
        if send(*frame):
            node.sent(now_ns)
        return True

    def _on_foreign_nmt(self, data: bytes, _: int) -> None:
        """Handle another device's NMT command."""
        if len(data) == 2 and data[1] in (0, self.node.node_id):
            self.node.on_foreign_nmt(data[0])

    def _on_emergency(self, data: bytes, stamp_ns: int) -> None:
        """Pass on an emergency message (CiA 301, 7.2.7)."""
        if len(data) == 8:
            self.emergency_code = code = int.from_bytes(data[:2], "little")
            message = EmergencyMessage(stamp_ns, self.node.node_id, code, data[2])
            self._notes.emergencies.append(message)
