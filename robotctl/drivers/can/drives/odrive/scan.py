"""Finds ODrives by their heartbeats, and by remote requests, which every firmware answers."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from robotctl.drivers.can.drives.odrive import wire
from robotctl.drivers.can.drives.odrive.wire import Command, NewCommand, OldCommand
from robotctl.drivers.can.probe import Found, Probe, Question, come_from_two
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, REMOTE_FLAG, Frame

_COMMAND_MASK: Final = 0x1F
"""Bits of an identifier that are the command."""
_OTHERS: Final = EXTENDED_FLAG | FD_FLAG

PRESENCE: Final = (Command.BUS_VOLTAGE_CURRENT, Command.IQ, Command.ENCODER_ESTIMATES)
"""Messages that both firmwares send when they are asked for."""

QUERIES: Final = frozenset(
    (
        *(NewCommand.VERSION, Command.HEARTBEAT, NewCommand.ERROR, NewCommand.TX_SDO, Command.IQ),
        *(Command.ENCODER_ESTIMATES, OldCommand.ENCODER_COUNT, NewCommand.TEMPERATURE),
        *(Command.BUS_VOLTAGE_CURRENT, OldCommand.CONTROLLER_ERROR),
    )
)
"""Messages that change nothing in an ODrive of either firmware, whatever their data."""

_STATES: Final = {0: "undefined", 1: "idle", 2: "starting", 8: "closed-loop control"}

_CANOPEN_HEARTBEATS: Final = range(0x701, 0x780)


class ODriveProbe(Probe):
    """See `Probe`."""

    def __init__(self) -> None:
        super().__init__(
            "CANSimple",
            [
                _question(node_id, command)
                for node_id in range(wire.NODE_ID_MAX + 1)
                for command in PRESENCE
            ],
        )
        self._versions: dict[int, bytes] = {}
        self._version_asked: set[int] = set()
        self._beats: dict[int, list[int]] = {}
        self._last_beat: dict[int, bytes] = {}
        self._no_beats: set[int] = set()
        self._unasked: set[int] = set()
        """Identifiers of frames that came before their question."""
        self._canopen: set[int] = set()
        """Node ids that CANopen devices have, whose frames may look like an ODrive's."""

    def on_sent(self, question: Question, now_ns: int) -> None:
        """Note a question."""
        super().on_sent(question, now_ns)
        if question.answer_id & _COMMAND_MASK == NewCommand.VERSION:
            self._version_asked.add(question.number)

    def obeyed_by(self, arbitration_id: int) -> Collection[int]:
        """Return the number whose command an identifier is."""
        if arbitration_id & (_OTHERS | REMOTE_FLAG):
            return ()
        node_id, command = divmod(arbitration_id, _COMMAND_MASK + 1)
        return () if command in QUERIES else (node_id,)

    def take(self, frame: Frame) -> None:
        """Take heartbeats and answers; note what only a host sends."""
        number = frame.arbitration_id
        if number & _OTHERS:
            return
        if number & REMOTE_FLAG:
            self.command_heard = self.command_heard or f"remote request 0x{number & 0x7FF:03X}"
            return
        if number in _CANOPEN_HEARTBEATS and len(frame.data) == 1:
            self._canopen.add(number & 0x7F)
            return
        node_id, command = divmod(number, _COMMAND_MASK + 1)
        if command == Command.HEARTBEAT:
            self._on_heartbeat(node_id, frame)
        elif command in wire.HOST_FRAMES and self._beats_of(node_id):
            name = f"{wire.HOST_FRAMES[command]} to ODrive {node_id}"
            self.command_heard = self.command_heard or name
        elif command == NewCommand.VERSION or command in PRESENCE:
            self._on_answer(node_id, command, frame)

    def _on_heartbeat(self, node_id: int, frame: Frame) -> None:
        data = frame.data
        if wire.strange_heartbeat(data, is_old=None):
            self._no_beats.add(node_id)
            return
        self._beats.setdefault(node_id, []).append(frame.stamp_ns)
        self._last_beat[node_id] = data
        if len(self._beats_of(node_id)) > 1:
            self._meet(node_id)
        if come_from_two(self._beats[node_id]):
            self.clashes(node_id, "its heartbeats have the rhythm of two devices")

    def _beats_of(self, node_id: int) -> list[int]:
        """Return the times of heartbeats, which all must have been such and not CANopen's."""
        identifier = wire.can_id(node_id, Command.HEARTBEAT)
        if node_id in self._no_beats or (identifier & 0x7F) in self._canopen:
            return []
        return self._beats.get(node_id, [])

    def _on_answer(self, node_id: int, command: int, frame: Frame) -> None:
        if not self.awaits(node_id, frame.stamp_ns):
            self._unasked.add(frame.arbitration_id)
            return
        if frame.arbitration_id in self._unasked or len(frame.data) != 8:
            return
        self._meet(node_id)
        if command != NewCommand.VERSION:
            return
        known = self._versions.setdefault(node_id, frame.data)
        if known is not frame.data:
            sign = "two different versions" if known != frame.data else "its version twice"
            self.clashes(node_id, f"one question was answered with {sign}")

    def _meet(self, node_id: int) -> None:
        """Note that an ODrive is there, and ask for its version."""
        if node_id not in self.heard:
            self.heard.add(node_id)
            self._open[node_id] = [_question(node_id, NewCommand.VERSION)]

    def found(self) -> tuple[Found, ...]:
        """Return all that answered, or whose heartbeats were heard."""
        return tuple(self._describe(node_id) for node_id in sorted(self.heard))

    def _describe(self, node_id: int) -> Found:
        version = self._versions.get(node_id)
        name = ""
        firmware = "0.5" if node_id in self._version_asked else ""
        if version is not None:
            found = wire.read_version(version)
            firmware = ".".join(map(str, found.firmware))
            name = f"hardware {'.'.join(map(str, found.hardware))}"
        return Found(
            "ODrive",
            node_id,
            kind="odrive",
            name=name,
            firmware=firmware,
            state=self._state(node_id),
            hints=("ratio: turns of the motor for one of the wheel",),
            clash=self._clashes.get(node_id, ""),
        )

    def _state(self, node_id: int) -> str:
        beat = self._last_beat.get(node_id)
        if beat is None or not self._beats_of(node_id):
            return "no heartbeat: set its rate in odrivetool"
        error, axis_state, *_ = wire.HEARTBEATS.unpack(beat)
        words = _STATES.get(axis_state, f"axis state {axis_state}")
        return f"{words}, error 0x{error:X}" if error else words


def _question(node_id: int, command: int) -> Question:
    # No data bytes: some controllers take those of the last frame for the data of a request.
    identifier = wire.can_id(node_id, command)
    return Question(node_id, identifier | REMOTE_FLAG, b"", identifier)
