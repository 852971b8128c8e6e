"""Finds moteus by registers that can only be read: mode, fault, versions, serial number."""

from __future__ import annotations

import struct
from collections.abc import Collection
from typing import Final

from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.faults import reported_fault
from robotctl.drivers.can.probe import Found, Probe, Question
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, Frame

QUERY: Final = wire.padded(bytes.fromhex("1100 110f 1a8102 1ba002"))
"""Reads mode and fault (8 bits), firmware and register map, and three words of serial number."""

_HEAD: Final = struct.Struct("<2sB2sB3sII")
_HEADS: Final = (b"\x21\x00", b"\x21\x0f", b"\x2a\x81\x02")
_SERIAL: Final = struct.Struct("<3sIII")
_SERIAL_HEAD: Final = b"\x2b\xa0\x02"

_MODES: Final = {
    0: "stopped",
    1: "fault",
    10: "position mode",
    11: "time-out",
    12: "zero velocity",
    15: "brake",
}


class MoteusProbe(Probe):
    """See `Probe`."""

    def __init__(self) -> None:
        super().__init__(
            "moteus",
            [
                Question(number, wire.command_id(number), QUERY, max(wire.answer_ids(number)))
                for number in range(1, wire.ID_MAX + 1)
            ],
        )
        self._answers: dict[int, bytes] = {}

    def obeyed_by(self, arbitration_id: int) -> Collection[int]:
        """Return whom a frame addresses: those of CAN FD.

        Its firmware reads classic frames, too, but does nothing without a write of the mode at
        their beginning, which no question or answer of the other protocols has.
        """
        plain = arbitration_id & 0x1FFF_FFFF
        number = plain & 0x7F
        return (number,) if arbitration_id & FD_FLAG and number and not plain & 0x80 else ()

    def take(self, frame: Frame) -> None:
        """Take answers to the host; note frames of another host."""
        if not frame.arbitration_id & FD_FLAG:
            return
        plain = frame.arbitration_id & ~(FD_FLAG | EXTENDED_FLAG)
        source, destination = plain >> 8 & 0x7F, plain & 0x7F
        if plain > 0xFFFF:
            return
        if destination != wire.HOST_ID:
            self.command_heard = self.command_heard or f"frame of {source} to moteus {destination}"
        elif source:
            self.heard.add(source)
            if source in self._asked_ns and frame.data.startswith(_HEADS[0]):
                self._on_answer(source, frame.data)

    def _on_answer(self, number: int, data: bytes) -> None:
        known = self._answers.setdefault(number, data)
        if known is not data:
            how = "two different answers" if known != data else "two answers"
            self.clashes(number, f"{how} came to one question")

    def found(self) -> tuple[Found, ...]:
        """Return all that were heard."""
        return tuple(self._describe(number) for number in sorted(self.heard))

    def _describe(self, number: int) -> Found:
        data = self._answers.get(number, b"")
        firmware = state = name = ""
        if len(data) >= _HEAD.size:
            head1, mode, head2, fault, head3, version, _ = _HEAD.unpack_from(data)
            if (head1, head2, head3) == _HEADS:
                firmware = f"{version >> 16 & 0xFF}.{version >> 8 & 0xFF}.{version & 0xFF}"
                state = (
                    reported_fault(fault, "").text if fault else _MODES.get(mode, f"mode {mode}")
                )
        if len(data) >= _HEAD.size + _SERIAL.size:
            head, *words = _SERIAL.unpack_from(data, _HEAD.size)
            if head == _SERIAL_HEAD:
                name = "serial " + "".join(f"{word:08x}" for word in reversed(words))
        return Found(
            "moteus",
            number,
            kind="moteus",
            name=name,
            firmware=firmware,
            state=state,
            hints=("ratio: turns of the drive's output for one of the wheel",),
            clash=self._clashes.get(number, ""),
        )
