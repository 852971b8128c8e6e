"""End-to-end protection of process data: 4-bit alive counter and CRC-8.

AUTOSAR E2E profile 1, data-id mode "both bytes" (AUTOSAR FO PRS E2EProtocol, 6.3): byte 0 is the
CRC, the low nibble of byte 1 the counter 0..14. CRC-8 with polynomial 0x1D, initial value 0x00 and
final xor 0x00, most significant bit first, over the low byte and the high byte of the data id and
then all payload bytes but the CRC itself.

Undetectable: a frame delayed by exactly a multiple of 15 counts, and one in 256 corruptions that
pass CAN's own CRC.
"""

from __future__ import annotations

import enum
import struct

POLYNOMIAL = 0x1D
COUNTER_MODULUS = 15
COUNTER_INVALID = 15
"""The sixteenth value of the nibble, never sent."""

_LENGTH = 8
_NO_REFERENCE = -1


def _table() -> tuple[int, ...]:
    table = []
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = ((crc << 1) ^ POLYNOMIAL if crc & 0x80 else crc << 1) & 0xFF
        table.append(crc)
    return tuple(table)


_TABLE = _table()
_TABLE16 = bytes([_TABLE[low] ^ high for high in _TABLE for low in _TABLE])
"""CRC-8 of two bytes by the word that they are, low byte first; the CRC of a sum is the sum."""
_AFTER_CRC = struct.Struct("<xHHHB")
"""The bytes of a protected frame after its CRC."""


def crc8(data: bytes, start: int = 0) -> int:
    """Return the CRC-8 [0, 255] of `data`, continuing from the CRC `start` of what precedes it."""
    table = _TABLE
    crc = start
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def frame_crc(data: bytes, start: int) -> int:
    """Return the CRC-8 that belongs into byte 0 of a frame of eight bytes, as `crc8` of the rest.

    `start` is the `data_id_crc` of the frame.
    """
    a, b, c, d = _AFTER_CRC.unpack(data)
    table = _TABLE16
    crc: int = _TABLE[table[table[table[a ^ start] ^ b] ^ c] ^ d]
    return crc


def data_id_crc(data_id: int) -> int:
    """Return the CRC-8 of a 16-bit data id, low byte first: the start value of its frames."""
    return crc8(data_id.to_bytes(2, "little"))


class Protector:
    """Sender side of one frame: gives each payload the next counter and its CRC.

    Parameters
    ----------
    data_id
        The 16-bit E2E_DataId of robot.dbc.
    """

    __slots__ = ("_start", "counter")

    def __init__(self, data_id: int) -> None:
        self._start = data_id_crc(data_id)
        self.counter = 0

    def protect(self, payload: int) -> bytes:
        """Return the eight bytes of `payload` with counter and CRC, and count on.

        Parameters
        ----------
        payload
            The frame as a 64-bit little-endian integer with zeros in bits 0..11.
        """
        frame = payload | self.counter << 8
        self.counter = (self.counter + 1) % COUNTER_MODULUS
        return (frame | frame_crc(frame.to_bytes(8, "little"), self._start)).to_bytes(8, "little")

    def reset(self) -> None:
        """Start again at counter 0, as after power-up."""
        self.counter = 0


class CheckStatus(enum.Enum):
    """A receiver's verdict on one frame. Only OK and OK_SOME_LOST may be used."""

    OK = "ok"
    OK_SOME_LOST = "ok_some_lost"
    INITIAL = "initial"
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong_sequence"
    WRONG_CRC = "wrong_crc"
    WRONG_LENGTH = "wrong_length"

    @property
    def usable(self) -> bool:
        """Whether the frame's content may be used."""
        return self is _OK or self is _OK_SOME_LOST


_OK, _OK_SOME_LOST = CheckStatus.OK, CheckStatus.OK_SOME_LOST


class Checker:
    """Receiver side of one frame: check state machine and its counters.

    The first good frame after `reset` only sets the reference. A frame with counter 15, which no
    sender uses, is a wrong sequence and does not move the reference.

    Parameters
    ----------
    data_id
        The 16-bit E2E_DataId of robot.dbc.
    max_delta
        Maximum accepted step of the counter, 1..14 (E2E_MaxDeltaCounter).

    Raises
    ------
    ValueError
        If `max_delta` is outside 1..14.
    """

    __slots__ = ("_max_delta", "_reference", "_start", "crc_rejects", "length_rejects", "lost",
                 "sequence_rejects")  # fmt: skip

    def __init__(self, data_id: int, max_delta: int = 3) -> None:
        if not 1 <= max_delta < COUNTER_MODULUS:
            raise ValueError(f"max_delta is {max_delta}, allowed are 1..14")
        self._start = data_id_crc(data_id)
        self._max_delta = max_delta
        self._reference = _NO_REFERENCE
        self.crc_rejects = 0
        self.sequence_rejects = 0
        """Repeated frames and jumps of the counter."""
        self.length_rejects = 0
        self.lost = 0
        """Frames missing before accepted ones."""

    def reset(self) -> None:
        """Forget the reference, as after start or a time-out; the counters stay."""
        self._reference = _NO_REFERENCE

    def check(self, data: bytes) -> CheckStatus:
        """Judge one received frame, move the reference and count."""
        if len(data) != _LENGTH:
            self.length_rejects += 1
            return CheckStatus.WRONG_LENGTH
        if frame_crc(data, self._start) != data[0]:
            self.crc_rejects += 1
            return CheckStatus.WRONG_CRC
        counter = data[1] & 0x0F
        reference = self._reference
        if counter == COUNTER_INVALID:
            self.sequence_rejects += 1
            return CheckStatus.WRONG_SEQUENCE
        self._reference = counter
        if reference == _NO_REFERENCE:
            return CheckStatus.INITIAL
        delta = (counter - reference) % COUNTER_MODULUS
        if delta == 1:
            return _OK
        if 1 < delta <= self._max_delta:
            self.lost += delta - 1
            return CheckStatus.OK_SOME_LOST
        self.sequence_rejects += 1
        return CheckStatus.REPEATED if delta == 0 else CheckStatus.WRONG_SEQUENCE
