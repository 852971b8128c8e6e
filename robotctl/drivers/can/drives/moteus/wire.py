"""Frames of moteus: identifiers, register subframes, and its diagnostic stream.

A frame's identifier is source << 8 | destination, with bit 15 where an answer is wanted; from
0x800 on it has 29 bits. A frame holds subframes, numbers are little-endian, what remains of a CAN
FD length is filled with 0x50. Sources: `docs/protocol/can.md` and `docs/protocol/registers.md` of
mjbots/moteus; for the stream mjlib's `multiplex/format.h`.
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from typing import Final

from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS

HOST_ID: Final = 0
"""Number of the host on the bus."""

ID_MAX: Final = 126
"""Greatest number of a drive; 127 addresses all."""

STOPPED, FAULT, POSITION, TIMEOUT, ZERO_VELOCITY, BRAKE = 0, 1, 10, 11, 12, 15
PREPARING: Final = frozenset((2, 3, 4))
"""Modes (register 0x000)."""

FIRMWARE_VERSION, REGISTER_MAP = 0x101, 0x102

_NOP: Final = 0x50
_NAN: Final = float("nan")

_QUERY: Final[bytes] = bytes.fromhex("1100 1e01 1504 170d 1970")
"""Reads mode (8 bits), position and velocity (float), Q current (16 bits), supply, temperature and
fault (16 bits), and the millisecond counter (32 bits): its answer fits into 32 bytes."""

_STATUS = struct.Struct("<2sb2sff2sh2shhh2sI")
_STATUS_HEADS: Final = (b"\x21\x00", b"\x2e\x01", b"\x25\x04", b"\x27\x0d", b"\x29\x70")
_STATUS_LENGTH: Final = 32

_POSITION = struct.Struct("<5sff2sf")
_POSITION_HEAD: Final = bytes.fromhex("01000a 0e20")
_WATCHDOG_HEAD: Final = bytes.fromhex("0d27")
_POSITION_TAIL: Final[bytes] = _QUERY + bytes((_NOP,)) * (32 - _POSITION.size - len(_QUERY))

AMPERES, VOLTS, DEGREES = 0.1, 0.1, 0.1
"""Units of current, voltage and temperature in 16 bits."""

_VERSIONS = struct.Struct("<3sII")
_VERSIONS_HEAD: Final = bytes.fromhex("2a 8102")

_STREAM_WRITE, STREAM_ANSWER, _STREAM_POLL = 0x40, 0x41, 0x42
_CHANNEL: Final = 1
_STREAM_MAX: Final = 48
"""Number of the diagnostic channel, and maximum bytes of an answer."""


def command_id(number: int, *, answered: bool = True) -> int:
    """Return the identifier, with its flags, of a frame to a drive."""
    return _with_flags((HOST_ID | 0x80 if answered else HOST_ID) << 8 | number)


def answer_ids(number: int) -> tuple[int, ...]:
    """Return the identifiers that an answer of a drive may have.

    Below 0x800 the document leaves open whether they have 11 or 29 bits.
    """
    plain = number << 8 | HOST_ID
    return tuple({_with_flags(plain), FD_FLAG | EXTENDED_FLAG | plain})


def _with_flags(plain: int) -> int:
    return FD_FLAG | (EXTENDED_FLAG | plain if plain > 0x7FF else plain)


def padded(data: bytes) -> bytes:
    """Fill a frame up to the next length of CAN FD."""
    length: int = FD_LENGTHS[bisect_left(FD_LENGTHS, len(data))]
    return data + bytes((_NOP,)) * (length - len(data))


def pack_velocity(turns_s: float, watchdog_s: float) -> bytes:
    """Return the data of a velocity command [turn/s], valid for a time [s], with the query.

    Position mode, beginning at the present position (NaN).
    """
    begin = _POSITION.pack(_POSITION_HEAD, _NAN, turns_s, _WATCHDOG_HEAD, watchdog_s)
    return begin + _POSITION_TAIL


def pack_mode(mode: int) -> bytes:
    """Return the data of a frame that commands a mode without values, with the query."""
    return padded(bytes((0x01, 0x00, mode)) + _QUERY)


def pack_query() -> bytes:
    """Return the data of a frame that commands nothing."""
    return padded(_QUERY)


def unpack_status(
    data: bytes,
) -> tuple[int, float, float, int, int, int, int, int] | None:
    """Return the answer to the query; None if it is none.

    Mode, position [turn], velocity [turn/s], Q current, supply, temperature (in `AMPERES`, `VOLTS`
    and `DEGREES`), fault code, millisecond counter.
    """
    if len(data) != _STATUS_LENGTH:
        return None
    fields = _STATUS.unpack_from(data)
    head1, mode, head2, turns, turns_s, head3, current = fields[:7]
    head4, supply, temperature, fault, head5, counter = fields[7:]
    if (head1, head2, head3, head4, head5) != _STATUS_HEADS:
        return None
    return mode, turns, turns_s, current, supply, temperature, fault, counter


def pack_read_versions() -> bytes:
    """Return the data of a frame that reads firmware version and register map."""
    return padded(bytes.fromhex("1a 8102"))


def unpack_versions(data: bytes) -> tuple[int, int] | None:
    """Return firmware version and register map version of an answer; None if it is none."""
    if len(data) < _VERSIONS.size or not data.startswith(_VERSIONS_HEAD):
        return None
    _, firmware, register_map = _VERSIONS.unpack_from(data)
    return firmware, register_map


VERSIONS_ANSWER: Final = _VERSIONS_HEAD


def pack_text(text: str) -> bytes:
    """Return the data of a frame that gives the diagnostic stream a line."""
    line = text.encode("ascii") + b"\n"
    return padded(bytes((_STREAM_WRITE, _CHANNEL, len(line))) + line)


def pack_poll() -> bytes:
    """Return the data of a frame that asks for what the diagnostic stream has to say."""
    return padded(bytes((_STREAM_POLL, _CHANNEL, _STREAM_MAX)))


def unpack_text(data: bytes) -> bytes | None:
    """Return what the diagnostic stream says; None if a frame is of another kind."""
    if len(data) < 3 or data[0] != STREAM_ANSWER or data[1] != _CHANNEL:
        return None
    length = data[2]
    return data[3 : 3 + length] if length <= len(data) - 3 else None
