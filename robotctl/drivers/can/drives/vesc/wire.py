"""Frames of VESC: identifiers, commands, status messages, and its buffers for longer packets.

Identifiers have 29 bits: command << 8 | number of the receiver, or of the sender of a status.
Integers are big-endian. Sources: `documentation/comm_can.md` of vedderb/bldc, and for the packets
inside buffers `comm/comm_can.c`, `comm/commands.c` and `confgenerator.c` there. STATUS_6 is 58
(`datatypes.h`), not 28 as older editions of the document say.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from typing import Final, NamedTuple

from robotctl.messages.ports import EXTENDED_FLAG

ID_MAX: Final = 254
"""Greatest number of a VESC; 255 addresses all."""

SET_CURRENT, SET_CURRENT_BRAKE, SET_RPM, SET_CURRENT_HANDBRAKE = 1, 2, 3, 12
FILL_RX_BUFFER, FILL_RX_BUFFER_LONG, PROCESS_RX_BUFFER, PROCESS_SHORT_BUFFER = 5, 6, 7, 8
STATUS, STATUS_4, STATUS_5 = 9, 16, 27
STATUS_COMMANDS: Final = (STATUS, 14, 15, STATUS_4, STATUS_5, 58)
"""Status 1 to 6."""
PING, PONG, NOTIFY_BOOT = 17, 18, 57
"""CAN_PACKET_ID."""

HOST_COMMANDS: Final = {
    0: "SET_DUTY",
    SET_CURRENT: "SET_CURRENT",
    SET_CURRENT_BRAKE: "SET_CURRENT_BRAKE",
    SET_RPM: "SET_RPM",
    4: "SET_POS",
    10: "SET_CURRENT_REL",
    11: "SET_CURRENT_BRAKE_REL",
    SET_CURRENT_HANDBRAKE: "SET_CURRENT_HANDBRAKE",
    13: "SET_CURRENT_HANDBRAKE_REL",
}
"""Commands to a motor, which only the host may send."""

COMM_FW_VERSION, COMM_SET_SERVO_POS, COMM_GET_APPCONF = 0, 12, 17
COMM_GET_VALUES_SELECTIVE, COMM_SET_APPCONF_NO_STORE = 50, 149
"""COMM_PACKET_ID: first byte of a packet in a buffer."""

TACHOMETER_PER_TURN: Final = 6
"""Counts of the tachometer for one electrical turn."""

ERPM_MAX: Final = (1 << 31) - 1
"""Greatest speed that the wire carries [erpm]."""

_VALUE = struct.Struct(">i")

STATUS_DATA: Final = struct.Struct(">ihh")
"""Speed [erpm], motor current in `AMPERES`, duty [0.001]."""

STATUS_4_DATA: Final = struct.Struct(">hhhh")
"""Temperatures of bridge and motor [0.1 degC], input current [0.1 A], position."""

STATUS_5_DATA: Final = struct.Struct(">ihh")
"""Tachometer [count], supply [0.1 V], and two bytes that the firmware reserves,"""

SHORT_STATUS_5_DATA: Final = struct.Struct(">ih")
"""or without them, as in the document."""

AMPERES: Final = 0.1
"""Unit of current in status messages [A]."""

_SERVO = struct.Struct(">BBBh")
_WHOLE, _NO_REPLY = 0, 2
"""Handling of a buffer: processed and answered, or only processed."""

_FAULT, _FLAGS = 1 << 15, 1 << 21
"""Bits of the mask of COMM_GET_VALUES_SELECTIVE: fault code, and time-out and kill switch."""

_VALUES = struct.Struct(">BI")
_QUERY = _VALUES.pack(COMM_GET_VALUES_SELECTIVE, _FAULT | _FLAGS)
_FLAG_TIMED_OUT, _FLAG_KILL_SWITCH = 1, 2

pack_value: Final = _VALUE.pack
"""Data of a simple command: the value, scaled, as an integer."""


def identifier(command: int, number: int) -> int:
    """Return the identifier, with its flag, of a command for a VESC or of its status."""
    return EXTENDED_FLAG | command << 8 | number


def to_frames(packet: bytes, number: int, reply_to: int) -> tuple[tuple[int, bytes], ...]:
    """Return the frames that put a packet into a buffer of a VESC, to be answered.

    Parameters
    ----------
    packet
        1 to 512 bytes.
    number
        Receiver.
    reply_to
        Number to which the answer goes.
    """
    if len(packet) <= 6:
        data = bytes((reply_to, _WHOLE)) + packet
        return ((identifier(PROCESS_SHORT_BUFFER, number), data),)
    frames = []
    offset = 0
    while offset < len(packet):
        if offset <= 255:
            fill = FILL_RX_BUFFER, bytes((offset,)) + packet[offset : offset + 7]
            offset += 7
        else:
            fill = FILL_RX_BUFFER_LONG, offset.to_bytes(2, "big") + packet[offset : offset + 6]
            offset += 6
        frames.append((identifier(fill[0], number), fill[1]))
    end = struct.pack(">BBHH", reply_to, _WHOLE, len(packet), binascii.crc_hqx(packet, 0))
    frames.append((identifier(PROCESS_RX_BUFFER, number), end))
    return tuple(frames)


def query(number: int, reply_to: int) -> tuple[int, bytes]:
    """Return the frame that asks a VESC for its fault code and flags."""
    return to_frames(_QUERY, number, reply_to)[0]


def pack_servo(reply_to: int, position: int) -> bytes:
    """Return the data of PROCESS_SHORT_BUFFER that moves the servo output, position in 1/1000."""
    return _SERVO.pack(reply_to, _NO_REPLY, COMM_SET_SERVO_POS, position)


class Report(NamedTuple):
    """Answer to `query`; the flags are None where an old firmware does not tell."""

    fault: int
    timed_out: bool | None
    kill_switch: bool | None


def unpack_report(packet: bytes) -> Report | None:
    """Return the answer to `query`, or None if the packet is none."""
    if len(packet) not in (6, 7) or packet[:5] != _QUERY:
        return None
    if len(packet) == 6:
        return Report(packet[5], None, None)
    flags = packet[6]
    return Report(packet[5], bool(flags & _FLAG_TIMED_OUT), bool(flags & _FLAG_KILL_SWITCH))


class Reassembly:
    """Puts a VESC's packets together from the frames of its buffers.

    The frames do not say who sent them, so that each VESC must have a number of its own to send
    its answers to.

    Parameters
    ----------
    sender
        Number of the VESC.
    take
        Called with each whole packet and the time of its last frame [ns].
    """

    __slots__ = ("_buffer", "_sender", "_take")

    def __init__(self, sender: int, take: Callable[[bytes, int], None]) -> None:
        self._sender = sender
        self._take = take
        self._buffer = bytearray()

    def on_fill(self, data: bytes, _: int) -> None:
        """Take FILL_RX_BUFFER."""
        if data:
            self._append(data[0], data[1:])

    def on_fill_long(self, data: bytes, _: int) -> None:
        """Take FILL_RX_BUFFER_LONG."""
        self._append(int.from_bytes(data[:2], "big"), data[2:])

    def on_short(self, data: bytes, stamp_ns: int) -> None:
        """Take PROCESS_SHORT_BUFFER."""
        if len(data) > 2 and data[0] == self._sender:
            self._take(data[2:], stamp_ns)

    def on_process(self, data: bytes, stamp_ns: int) -> None:
        """Take PROCESS_RX_BUFFER; a packet that is not whole is dropped."""
        packet = bytes(self._buffer)
        self._buffer.clear()
        if len(data) != 6 or data[0] != self._sender:
            return
        length, crc = struct.unpack_from(">HH", data, 2)
        if length == len(packet) and crc == binascii.crc_hqx(packet, 0):
            self._take(packet, stamp_ns)

    def _append(self, offset: int, data: bytes) -> None:
        if offset == 0:
            self._buffer.clear()
        if offset == len(self._buffer):
            self._buffer += data
