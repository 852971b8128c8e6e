"""CAN_FORWARD: the frames of the robot's CAN bus to who asks for them, SDO requests back to it.

Whoever wants them asks again every few seconds, as of ArduPilot (libraries/AP_CANManager). Frames
come in while the robot is not armed, and only requests to SDO servers (CiA 301: 0x600 and the
node): no command, no NMT, nothing that a node could take for the host.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import ACCEPTED, DENIED, FAILED, Command
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer
from robotctl.messages.ports import FD_FLAG

FORWARD: Final[int] = common.MAV_CMD_CAN_FORWARD
LASTS_NS: Final = 5_000_000_000
"""Time after the last request for which frames go out [ns]."""
PER_STEP: Final = 32
"""Frames passed on in a step of 10 ms; of a flood the rest is left out."""
FIRST_SDO, LAST_SDO = 0x601, 0x67F
_CLASSIC: Final = 8
"""Bytes of a frame at most."""
_FD: Final = 64
"""Bytes of a frame of CAN FD at most."""
_ID_MASK: Final = 0xFFFF_FFFF
"""Identifier with the flag of one of 29 bits, as MAVLink and SocketCAN have it."""
_MOST_PEERS: Final = 4
_MOST_IDS: Final = 64
"""Maximum number of peers that listen, and of identifiers that each chooses."""


@dataclass(slots=True)
class _Listener:
    """A peer that gets frames: until when [ns], and which identifiers, all where there are none."""

    until_ns: int
    ids: set[int] = field(default_factory=set)


class CanForward(Microservice):
    """Passes frames on; the bus is open only while a station listens."""

    handles = frozenset({common.MAVLINK_MSG_ID_CAN_FRAME, common.MAVLINK_MSG_ID_CAN_FILTER_MODIFY})
    commands = frozenset({FORWARD})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._listeners: dict[Peer, _Listener] = {}

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take CAN_FORWARD: param1 1 is the robot's bus, 0 ends it."""
        if command.params[0] == 0.0:
            self._listeners.pop(command.peer, None)
            return ACCEPTED
        listener = self._listeners.get(command.peer)
        if command.params[0] != 1.0 or (listener is None and len(self._listeners) >= _MOST_PEERS):
            return DENIED
        if not self._context.can.open():
            self._context.say(now_ns, "CAN: the bus cannot be opened")
            return FAILED
        if listener is None:
            listener = self._listeners[command.peer] = _Listener(0)
        listener.until_ns = now_ns + LASTS_NS
        return ACCEPTED

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a frame for the bus, or the choice of a peer's identifiers."""
        listener = self._listeners.get(peer)
        if listener is None or message.bus != 0:
            return
        if message.get_msgId() == common.MAVLINK_MSG_ID_CAN_FRAME:
            self._send(message, now_ns)
            return
        ids = set(message.ids[: message.num_ids])
        match message.operation:
            case common.CAN_FILTER_REPLACE:
                listener.ids = ids
            case common.CAN_FILTER_ADD if len(listener.ids | ids) <= _MOST_IDS:
                listener.ids |= ids
            case common.CAN_FILTER_REMOVE:
                listener.ids -= ids

    def _send(self, message: Message, now_ns: int) -> None:
        """Send a request to an SDO server; say of others why not."""
        control = self._context.fresh_control(now_ns)
        if control is None or self._context.is_armed(now_ns):
            self._context.say(now_ns, "CAN: no frame is sent unless the robot is disarmed")
        elif not FIRST_SDO <= message.id <= LAST_SDO or message.len > _CLASSIC:
            allowed = f"0x{FIRST_SDO:X} to 0x{LAST_SDO:X} allowed: SDO requests"
            self._context.say(now_ns, f"CAN: 0x{message.id:X} found, {allowed}")
        else:
            self._context.can.send(message.id, bytes(message.data[: message.len]))

    def step(self, now_ns: int) -> None:
        """Pass on new frames; close the bus once no station listens any more."""
        if not self._listeners:
            return
        for peer, listener in list(self._listeners.items()):
            if now_ns > listener.until_ns or peer not in self._context.peers:
                del self._listeners[peer]
        if not self._listeners:
            self._context.can.close()
            return
        for number, data in self._context.can.receive()[:PER_STEP]:
            wanted = [
                peer
                for peer, each in self._listeners.items()
                if not each.ids or number & _ID_MASK in each.ids
            ]
            if wanted:
                self._context.links.broadcast(_forwarded(number, data), wanted)


def _forwarded(number: int, data: bytes) -> Message:
    """Return a frame, its identifier with the flags of `Frame`, as a MAVLink message."""
    number, is_fd = number & _ID_MASK, bool(number & FD_FLAG)
    size = _FD if is_fd else _CLASSIC
    make = common.MAVLink_canfd_frame_message if is_fd else common.MAVLink_can_frame_message
    return make(0, 0, 0, len(data), number, list(data.ljust(size, b"\0")))
