"""Finds CANopen devices: heartbeats, and reads of device type, identity, name and status word."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from robotctl.drivers.can.nodes.can_node import CanNode
from robotctl.drivers.can.nodes.commissioning import VENDOR_ID
from robotctl.drivers.can.nodes.identifiers import NODE_ID_MAX, PDO_STEP, CobId, NmtState
from robotctl.drivers.can.nodes.sdo import Request
from robotctl.drivers.can.probe import ANSWER_NS, Found, Probe, Question, come_from_two
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, REMOTE_FLAG, Frame

DEVICE_TYPE, VENDOR, PRODUCT, REVISION, SERIAL = (
    (0x1000, 0),
    *((0x1018, subindex) for subindex in (1, 2, 3, 4)),
)
NAME, STATUS_WORD = (0x1008, 0), (0x6041, 0)
"""Objects that are read: index and sub-index."""

PROFILE_402: Final = 402
"""Device profile of drives (object 1000h, lower 16 bits)."""

_READ_OF_EACH: Final = (VENDOR, PRODUCT, REVISION, SERIAL, NAME)
_PAUSE_NS: Final = 15_000_000
"""Least time from one request to a server to the next [ns]: some lose what comes sooner."""

_ALL: Final = range(1, NODE_ID_MAX + 1)
_EMERGENCY_STOP: Final = 0x001
"""Identifier of frames that stop our own motor controller (robot.dbc)."""
_COMMANDS: Final = (
    *(CobId.RPDO + PDO_STEP * place for place in range(4)),
    CobId.SDO_REQUEST,
)
"""Bases of the identifiers that a node receives: RPDOs, and SDO requests."""

_STATES: Final[dict[int, str]] = {
    NmtState.BOOT_UP: "booting",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "operational",
    NmtState.PRE_OPERATIONAL: "pre-operational",
}
_OTHERS: Final = EXTENDED_FLAG | FD_FLAG

_ABORT, _SEGMENTS_MAX = 0x80, 12
_EXPEDITED, _SIZED, _LAST = 0x02, 0x01, 0x01


@dataclass(slots=True)
class Device:
    """A CANopen device as far as it is known.

    Attributes
    ----------
    node_id
        Its node id.
    state
        NMT state in words; empty: no heartbeat came.
    values
        Objects read; None: it refused.
    """

    node_id: int
    state: str = ""
    values: dict[tuple[int, int], bytes | None] = field(default_factory=dict)

    def number(self, key: tuple[int, int]) -> int | None:
        """Return an object as an unsigned number; None if it was not read."""
        value = self.values.get(key)
        return None if value is None else int.from_bytes(value, "little")

    @property
    def name(self) -> str:
        """Manufacturer's name of it."""
        return (self.values.get(NAME) or b"").decode("ascii", "replace").strip("\0 ")

    @property
    def profile(self) -> int | None:
        """Number of its device profile."""
        kind = self.number(DEVICE_TYPE)
        return None if kind is None else kind & 0xFFFF

    @property
    def firmware(self) -> str:
        """Revision of its identity object."""
        revision = self.number(REVISION)
        return "" if revision is None else f"{revision >> 16}.{revision & 0xFFFF}"


@dataclass(slots=True)
class _Transfer:
    """A read under way: its object, and what has come of a long one."""

    key: tuple[int, int]
    sent_ns: int
    data: bytes | None = None
    """Content of a segmented transfer; None: the initial answer is awaited."""
    toggle: int = 0
    segments: int = 0
    waits: bool = True
    """Whether a request has no answer yet."""


class CanopenProbe(Probe):
    """Finds the CANopen devices of one kind.

    Parameters
    ----------
    describe
        Returns the finding of a device, None if it is of another kind; the sign of a clash is added
        here.
    """

    def __init__(self, describe: Callable[[Device], Found | None]) -> None:
        super().__init__(
            "CANopen",
            [_reading(node_id, Request(*DEVICE_TYPE, "device type")) for node_id in _ALL],
        )
        self._describe = describe
        self._devices: dict[int, Device] = {}
        self._transfers: dict[int, _Transfer] = {}
        self._answered: dict[tuple[int, tuple[int, int]], bytes] = {}
        self._beats: dict[int, list[int]] = {}

    # Questions ----------------------------------------------------------------------------------

    def questions(self, now_ns: int) -> list[Question]:
        """Return the first read of each number, and the next of each device that answered."""
        further = [self._next(each, now_ns) for each in self._devices.values()]
        return super().questions(now_ns) + [each for each in further if each is not None]

    def _next(self, device: Device, now_ns: int) -> Question | None:
        """Return the next read of a device; None while it needs a pause, and at the end."""
        node_id = device.node_id
        transfer = self._transfers.get(node_id)
        if node_id in self._open or now_ns - self._asked_ns.get(node_id, now_ns) < _PAUSE_NS:
            return None
        if transfer is not None:
            if transfer.data is not None and not transfer.waits:
                return _segment(node_id, transfer.toggle)
            if now_ns - transfer.sent_ns < ANSWER_NS:
                return None
            self._end(device, transfer.key, None)
        wanted = [DEVICE_TYPE, *_READ_OF_EACH]
        if device.profile == PROFILE_402:
            wanted.append(STATUS_WORD)
        for key in wanted:
            if key not in device.values:
                return _reading(node_id, Request(*key, ""))
        return None

    def on_sent(self, question: Question, now_ns: int) -> None:
        """Note a read, or that its next segment is awaited."""
        super().on_sent(question, now_ns)
        transfer = self._transfers.get(question.number)
        if transfer is not None and transfer.data is not None:
            transfer.segments += 1
            transfer.sent_ns = now_ns
            transfer.waits = True
            return
        index, subindex = int.from_bytes(question.data[1:3], "little"), question.data[3]
        self._transfers[question.number] = _Transfer((index, subindex), now_ns)

    def obeyed_by(self, arbitration_id: int) -> Collection[int]:
        """Return the node ids whose devices take a frame for a command.

        A heartbeat may start the supervision of its sender, and so may a request of node guarding.
        """
        if arbitration_id & _OTHERS:
            return ()
        plain = arbitration_id & 0x7FF
        node_id = plain & 0x7F
        if arbitration_id & REMOTE_FLAG:
            return (node_id,) if node_id and plain - node_id == CobId.HEARTBEAT else ()
        if plain in (CobId.NMT, _EMERGENCY_STOP, CobId.SYNC) or plain - CobId.HEARTBEAT in _ALL:
            return _ALL
        return (node_id,) if node_id and plain - node_id in _COMMANDS else ()

    # Frames -------------------------------------------------------------------------------------

    def take(self, frame: Frame) -> None:
        """Take heartbeats and answers; note what only a controller sends."""
        number, data = frame.arbitration_id, frame.data
        if number & _OTHERS:
            return
        plain = number & 0x7FF
        node_id = plain & 0x7F
        base = plain - node_id
        if number & REMOTE_FLAG:
            if base == CobId.HEARTBEAT:
                self._hear_command(f"node guarding of {node_id}")
        elif base == CobId.HEARTBEAT and len(data) == 1:
            self._on_heartbeat(node_id, frame)
        elif base == CobId.SDO_RESPONSE and len(data) == 8:
            self._on_answer(node_id, data)
        elif (plain == CobId.NMT and len(data) == 2) or (plain == CobId.SYNC and len(data) <= 1):
            self._hear_command("NMT command" if plain == CobId.NMT else "SYNC")
        elif base == CobId.SDO_REQUEST and _is_request(data):
            self._hear_command(f"SDO request to node {node_id}")
        elif base in _COMMANDS[:-1] and self._beats.get(node_id):
            self._hear_command(f"RPDO {plain >> 8} to node {node_id}")

    def _hear_command(self, name: str) -> None:
        self.command_heard = self.command_heard or name

    def _on_heartbeat(self, node_id: int, frame: Frame) -> None:
        state = frame.data[0] & 0x7F
        if state not in _STATES or not node_id:
            return
        stamps_ns = self._beats.setdefault(node_id, [])
        stamps_ns.append(frame.stamp_ns)
        if come_from_two(stamps_ns):
            self.clashes(node_id, "its heartbeats have the rhythm of two devices")
        self._meet(node_id).state = _STATES[state]

    def _meet(self, node_id: int) -> Device:
        self.heard.add(node_id)
        return self._devices.setdefault(node_id, Device(node_id))

    def _on_answer(self, node_id: int, data: bytes) -> None:
        """Take an answer to the read under way; a second one is of a second device."""
        key = int.from_bytes(data[1:3], "little"), data[3]
        transfer = self._transfers.get(node_id)
        before = self._answered.get((node_id, key))
        if transfer is not None and transfer.data is not None:
            if data[0] >> 5 == 0:
                self._on_segment(node_id, transfer, data)
            elif before is not None:
                self.clashes(node_id, _two(before, data))
            return
        if before is not None:
            self.clashes(node_id, _two(before, data))
        elif transfer is not None and transfer.key == key:
            self._answered[node_id, key] = data
            self._on_first(node_id, transfer, data)

    def _on_first(self, node_id: int, transfer: _Transfer, data: bytes) -> None:
        command = data[0]
        device = self._meet(node_id)
        if command == _ABORT or command >> 5 != 2:
            self._end(device, transfer.key, None)
        elif command & _EXPEDITED:
            size = 4 - (command >> 2 & 3) if command & _SIZED else 4
            self._end(device, transfer.key, data[4 : 4 + size])
        else:
            transfer.data = b""
            transfer.waits = False

    def _on_segment(self, node_id: int, transfer: _Transfer, data: bytes) -> None:
        if transfer.data is None or data[0] & 0x10 != transfer.toggle:
            return
        transfer.data += data[1 : 8 - (data[0] >> 1 & 7)]
        transfer.toggle ^= 0x10
        transfer.waits = False
        if data[0] & _LAST or transfer.segments >= _SEGMENTS_MAX:
            self._end(self._meet(node_id), transfer.key, transfer.data)

    def _end(self, device: Device, key: tuple[int, int], value: bytes | None) -> None:
        device.values[key] = value
        self._transfers.pop(device.node_id, None)

    # Findings -----------------------------------------------------------------------------------

    def found(self) -> tuple[Found, ...]:
        """Return the devices of its kind."""
        described = (self._describe(self._devices[each]) for each in sorted(self._devices))
        return tuple(
            _with_clash(each, self._clashes.get(each.number, ""))
            for each in described
            if each is not None
        )


def own_probe(nodes: Sequence[CanNode]) -> CanopenProbe:
    """Return the probe of our own sensor nodes."""
    names = {node.node_id: node.name for node in nodes}
    return CanopenProbe(lambda device: own_device(device, names))


def own_device(device: Device, names: dict[int, str]) -> Found | None:
    """Return a device of ours, which has one of some product codes; None if it is none of them."""
    product = device.number(PRODUCT)
    if device.number(VENDOR) != VENDOR_ID or product not in names:
        return None
    return Found(
        "robotctl",
        device.node_id,
        name=names[product],
        firmware=device.firmware,
        state=device.state or "no heartbeat",
    )


def _with_clash(found: Found, clash: str) -> Found:
    return replace(found, clash=clash)


def _reading(node_id: int, request: Request) -> Question:
    return Question(
        node_id, CobId.SDO_REQUEST + node_id, request.frame(), CobId.SDO_RESPONSE + node_id
    )


def _segment(node_id: int, toggle: int) -> Question:
    data = bytes((0x60 | toggle,)) + bytes(7)
    return Question(node_id, CobId.SDO_REQUEST + node_id, data, CobId.SDO_RESPONSE + node_id)


def _is_request(data: bytes) -> bool:
    """Return whether data begin an SDO transfer of an object of CiA 301 or a profile."""
    begins = data[:1] == b"\x40" or data[:1] in (b"\x22", b"\x23", b"\x27", b"\x2b", b"\x2f")
    return len(data) == 8 and begins and data[2] >= 0x10


def _two(before: bytes, data: bytes) -> str:
    how = "two answers" if before == data else "two different answers"
    return f"{how} came to one question"
