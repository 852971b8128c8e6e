"""Finds VESCs by their status, by ping, and by reads of version and fault code."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.faults import reported_fault
from robotctl.drivers.can.probe import Found, Probe, Question, come_from_two
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, Frame

PONGS_TO: Final = 254
"""Number to which pings are answered; a VESC with that number ignores a pong."""

_OTHERS: Final = (5, 6, 7, 8, 22, 23, 24, 25, 30, 31, 39, 40, 41, 42, 43, 44, 51)
"""Further commands: buffers, currents, limits, and updates (CAN_PACKET_ID in `datatypes.h`)."""

COMMANDS: Final = frozenset({*wire.HOST_COMMANDS, *_OTHERS})

_TOLD: Final = (*wire.STATUS_COMMANDS, wire.NOTIFY_BOOT)
"""Messages that carry the sender's number."""


class VescProbe(Probe):
    """See `Probe`."""

    def __init__(self) -> None:
        super().__init__(
            "VESC",
            [
                Question(
                    number,
                    wire.identifier(wire.PING, number),
                    bytes((PONGS_TO,)),
                    wire.identifier(wire.PONG, PONGS_TO),
                )
                for number in range(wire.ID_MAX + 1)
            ],
        )
        self._pongs: set[int] = set()
        self._versions: dict[int, bytes] = {}
        self._reports: dict[int, wire.Report] = {}
        self._asked: dict[int, list[Question]] = {}
        """Pending reads of each device found."""
        self._reply_to: dict[int, int] = {}
        self._readers: dict[int, wire.Reassembly] = {}
        """Receivers of answers, by the number to which those go."""
        self._statuses: dict[int, list[int]] = {}
        self._begun: set[int] = set()
        """Numbers to which an answer to the last question has begun."""

    def obeyed_by(self, arbitration_id: int) -> Collection[int]:
        """Return whom a command addresses."""
        if arbitration_id & FD_FLAG or not arbitration_id & EXTENDED_FLAG:
            return ()
        command, number = divmod(arbitration_id & 0x1FFF_FFFF, 256)
        if command not in COMMANDS:
            return ()
        return range(wire.ID_MAX + 1) if number > wire.ID_MAX else (number,)

    def questions(self, now_ns: int) -> list[Question]:
        """Return pings; once all are answered, reads, one after another to each VESC."""
        if self._open:
            return super().questions(now_ns)
        if self.is_waiting(now_ns):
            return []
        self._plan()
        return [each for questions in self._asked.values() for each in questions[:1]]

    def _plan(self) -> None:
        """Choose a number for the answers of each: the frames do not say who sent them."""
        free = (number for number in range(PONGS_TO, 127, -1) if number not in self.heard)
        taken = set(self._readers)
        for number in sorted(self.heard - set(self._asked)):
            reply_to = next((each for each in free if each not in taken), None)
            if reply_to is None:
                return
            self._readers[reply_to] = self._reader(number)
            self._reply_to[number] = reply_to
            self._asked[number] = [
                Question(number, *frame, wire.identifier(wire.FILL_RX_BUFFER, reply_to))
                for frame in (
                    *wire.to_frames(bytes((wire.COMM_FW_VERSION,)), number, reply_to),
                    wire.query(number, reply_to),
                )
            ]

    def _reader(self, number: int) -> wire.Reassembly:
        return wire.Reassembly(number, lambda packet, _: self._on_packet(number, packet))

    def on_sent(self, question: Question, now_ns: int) -> None:
        """Note a ping, or a read."""
        super().on_sent(question, now_ns)
        if question in self._asked.get(question.number, ()):
            self._asked[question.number].remove(question)
            self._begun.discard(self._reply_to[question.number])

    def take(self, frame: Frame) -> None:
        """Take status messages and answers; note commands of a host."""
        if frame.arbitration_id & FD_FLAG or not frame.arbitration_id & EXTENDED_FLAG:
            return
        command, number = divmod(frame.arbitration_id & 0x1FFF_FFFF, 256)
        if command in _TOLD and number <= wire.ID_MAX:
            self.heard.add(number)
            self._on_status(command, number, frame)
        elif command == wire.PONG and number == PONGS_TO and frame.data:
            self._on_pong(frame.data[0])
        elif (reader := self._readers.get(number)) is not None:
            self._note_begin(command, number, frame.data)
            self._read(reader, command, frame)
        elif command in wire.HOST_COMMANDS or command in (wire.PING, wire.PROCESS_SHORT_BUFFER):
            name = wire.HOST_COMMANDS.get(command, "question")
            self.command_heard = self.command_heard or f"{name} to VESC {number}"

    def _note_begin(self, command: int, reply_to: int, data: bytes) -> None:
        """Note where an answer begins; twice, two devices answer."""
        if command == wire.FILL_RX_BUFFER and data[:1] == b"\0":
            if reply_to in self._begun:
                number = next(each for each, to in self._reply_to.items() if to == reply_to)
                self.clashes(number, "one question was answered twice")
            self._begun.add(reply_to)

    @staticmethod
    def _read(reader: wire.Reassembly, command: int, frame: Frame) -> None:
        match command:
            case wire.FILL_RX_BUFFER:
                reader.on_fill(frame.data, frame.stamp_ns)
            case wire.FILL_RX_BUFFER_LONG:
                reader.on_fill_long(frame.data, frame.stamp_ns)
            case wire.PROCESS_RX_BUFFER:
                reader.on_process(frame.data, frame.stamp_ns)
            case wire.PROCESS_SHORT_BUFFER:
                reader.on_short(frame.data, frame.stamp_ns)

    def _on_status(self, command: int, number: int, frame: Frame) -> None:
        if command != wire.STATUS:
            return
        stamps_ns = self._statuses.setdefault(number, [])
        stamps_ns.append(frame.stamp_ns)
        if come_from_two(stamps_ns):
            self.clashes(number, "its status has the rhythm of two devices")

    def _on_pong(self, number: int) -> None:
        if number in self._pongs:
            self.clashes(number, "one ping was answered twice")
        self._pongs.add(number)
        self.heard.add(number)

    def _on_packet(self, number: int, packet: bytes) -> None:
        if packet[:1] == bytes((wire.COMM_FW_VERSION,)):
            self._versions[number] = packet
        elif (report := wire.unpack_report(packet)) is not None:
            self._reports[number] = report

    def found(self) -> tuple[Found, ...]:
        """Return all that were heard."""
        return tuple(self._describe(number) for number in sorted(self.heard))

    def _describe(self, number: int) -> Found:
        firmware = name = state = ""
        packet = self._versions.get(number)
        if packet is not None and len(packet) >= 3:
            firmware = f"{packet[1]}.{packet[2]:02}"
            name = packet[3:].split(b"\0")[0].decode("ascii", "replace")
        report = self._reports.get(number)
        if report is not None:
            state = reported_fault(report.fault, "").text if report.fault else "no fault"
        return Found(
            "VESC",
            number,
            kind="vesc",
            name=name,
            firmware=firmware,
            state=state,
            keys={"pole_pairs": 7, "brake_current_a": 0.0},
            hints=(
                "pole_pairs: of the motor; ratio: turns of the motor for one of the wheel",
                "brake_current_a: motor current that brakes it when the host dies; give it one",
            ),
            clash=self._clashes.get(number, ""),
        )
