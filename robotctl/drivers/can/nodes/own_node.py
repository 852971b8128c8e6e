"""One node of our own protocol on its bus: its services and its protected process data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from robotctl.drivers.can.bus_load import transmission_type
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.bus_part import Handler
from robotctl.drivers.can.dbc import Message
from robotctl.drivers.can.e2e import SURPLUS_ON_SYNC, SURPLUS_TIMED, E2eReceiver
from robotctl.drivers.can.nodes.can_node import NodeFrame, Value
from robotctl.drivers.can.nodes.commissioning import Script
from robotctl.drivers.can.nodes.node import Node
from robotctl.drivers.can.nodes.node_part import NodePart
from robotctl.drivers.can.nodes.robot_codec import SYNC, RobotCodec
from robotctl.messages.control import StrangerKind

READ_BACK_NS: Final = 100_000_000
"""Period of reading back one setting of a node [ns]: all seven of the drive take 0.7 s."""

_LATE: Final = 1.2
"""Maximum interval of a message with a timer of its own, as a multiple of its period."""


class Sink(NamedTuple):
    """A place for what frames say: a list, a place in it, and whether it keeps all of a tick."""

    values: list[Any]
    place: int
    keeps_all: bool = False


class OwnNode(NodePart):
    """A node that `configs/robot.dbc` describes.

    Parameters
    ----------
    node_id
        CANopen node id, 1 to 127.
    name
        Name shown to people.
    script
        Makes a new run of its commissioning script.
    frames
        Its protected messages, and the sink of each.
    codec
        Compiled from the DBC.
    notes
        Notes about its bus.
    heartbeat_timeout_ns
        A node silent for longer is lost [ns].
    rate_hz
        Rate of SYNC [Hz].
    steered
        Whether DriveStatus comes on every SYNC.

    Attributes
    ----------
    host_frames
        Names of the frames on its bus that only the host may send, by identifier.
    """

    wants_sync = False

    def __init__(
        self,
        node_id: int,
        name: str,
        script: Callable[[], Script],
        frames: Mapping[NodeFrame, Sink],
        codec: RobotCodec,
        notes: BusNotes,
        heartbeat_timeout_ns: int,
        rate_hz: int,
        *,
        steered: bool = False,
    ) -> None:
        node = Node(node_id, name, script, heartbeat_timeout_ns, notes.strangers)
        super().__init__(node, notes)
        self.host_frames: Mapping[int, str] = codec.host_only
        self._read_back_ns: int | None = None
        sync = codec.dbc.message(SYNC)
        for frame, sink in frames.items():
            message = codec.dbc.message(frame.message)
            period_ns, on_sync = _period_ns(message, sync, rate_hz, steered=steered)
            receiver = _receiver(message, period_ns, notes, name, on_sync=on_sync)
            node.data.watch(receiver, period_ns if on_sync else round(_LATE * period_ns))
            self.handlers[message.arbitration_id] = _guarded(
                receiver, codec.readers[frame.message], sink
            )

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now; from time to time read a setting back."""
        self.node.check(now_ns)
        if self._read_back_ns is None:
            self._read_back_ns = now_ns + 1  # with the first command, which is behind this call
        elif now_ns >= self._read_back_ns:
            self._read_back_ns = now_ns + READ_BACK_NS
            self.node.read_back(now_ns)


def _period_ns(message: Message, sync: Message, rate_hz: int, *, steered: bool) -> tuple[int, bool]:
    """Return how often a message is sent [ns], and whether by SYNC."""
    if message.send_type != "OnSync":
        return message.cycle_ms * 1_000_000, False
    every = transmission_type(message, sync, rate_hz, steered=steered)
    return every * 1_000_000_000 // rate_hz, True


def _receiver(
    message: Message, period_ns: int, notes: BusNotes, name: str, *, on_sync: bool
) -> E2eReceiver:
    """Return the receiver of a message, which notes a second sender."""
    note, arbitration_id = notes.strangers.note, message.arbitration_id
    return E2eReceiver(
        message,
        period_ns,
        notes.counters,
        SURPLUS_ON_SYNC if on_sync else SURPLUS_TIMED,
        lambda stamp_ns: note(
            StrangerKind.SECOND_SENDER, message.name, arbitration_id, name, stamp_ns
        ),
    )


def _guarded(receiver: E2eReceiver, read: Callable[[bytes, int], Value], sink: Sink) -> Handler:
    """Return a handler that keeps what the receiver accepts: the newest, or all of a tick."""
    accept, (values, place, keeps_all) = receiver.accept, sink

    def keep_newest(data: bytes, stamp_ns: int) -> None:
        if accept(data, stamp_ns):
            values[place] = read(data, stamp_ns)

    def keep_all(data: bytes, stamp_ns: int) -> None:
        if accept(data, stamp_ns):
            values[place] += (read(data, stamp_ns),)

    return keep_all if keeps_all else keep_newest
