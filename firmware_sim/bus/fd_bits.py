"""Bits of a CAN FD frame on the wire: two bit rates, stuff count, fixed stuff bits, CRC-17 and 21.

Source: ISO 11898-1:2015, clause 10.4 (frame formats), 10.5 (stuffing, stuff count and CRC).

Up to the data field bits are stuffed as in a classic frame. Stuff bits at fixed places of the CRC
field follow; where the data ends with five equal bits, the first of them takes the place of the
stuff bit that would come. The CRC covers the stuff bits of the data and the stuff count, and its
value does not change the length of the frame.

With bit-rate switch, the bits from the sample point of BRS to that of the CRC delimiter have the
data bit rate. Both bits together take one nominal and one data bit wherever the sample points are,
so here BRS is nominal and the CRC delimiter fast.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from firmware_sim.bus.bits import checksum, classic_bit_sequence, frame_bits, stuff, stuff_step
from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    CLASSIC_MAX,
    ERROR_STATE_FLAG,
    EXTENDED_FLAG,
    EXTENDED_MASK,
    FD_LENGTHS,
    STANDARD_MASK,
)

CRC17_POLYNOMIAL = 0x1685B
"""x^17 + x^16 + x^14 + x^13 + x^11 + x^6 + x^4 + x^3 + x + 1; initial value 2^16."""
CRC21_POLYNOMIAL = 0x102899
"""x^21 + x^20 + x^13 + x^11 + x^7 + x^4 + x^3 + 1; initial value 2^20."""
CRC17_MAX_LENGTH = 16
"""Data bytes up to which a frame has the shorter CRC."""

_STUFF_COUNT_BITS = 4
_ACKNOWLEDGE_TO_END_BITS = 9
"""Acknowledge slot and delimiter, end of frame (7)."""
_STUFF_COUNTS = tuple(
    gray << 1 | gray.bit_count() & 1 for gray in (count ^ count >> 1 for count in range(8))
)
"""Stuff count modulo 8 in Gray code, and its parity."""


class FrameLength(NamedTuple):
    """Length of a frame from start of frame to end of frame, classic or FD.

    Attributes
    ----------
    bits
        All bits.
    data_phase, fast_bits
        Bits before the data phase of CAN FD, and number of its bits at the data bit rate: all, or
        none without bit-rate switch.
    """

    bits: int
    data_phase: int
    fast_bits: int


def frame_length(arbitration_id: int, data: bytes) -> FrameLength:
    """Return the length of a frame; the intermission comes on top.

    Parameters
    ----------
    arbitration_id
        Id with flags as in `Frame`.
    data
        As many bytes as `check_frame` allows.
    """
    if arbitration_id <= CLASSIC_MAX:
        return FrameLength(frame_bits(arbitration_id, data), 0, 0)
    length = len(data)
    key = arbitration_id << 7 | length
    header = _headers.get(key)
    arbitration_bits, fast_bits, step = _header(key) if header is None else header
    if length:
        step = stuff(step, np.frombuffer(data, np.uint8))
        fast_bits += step >> 4
        if ((step & 15) > 4) != (data[-1] & 1):  # the fixed stuff bit takes the place of this one
            fast_bits -= 1
    bits = arbitration_bits + fast_bits + _ACKNOWLEDGE_TO_END_BITS
    fast = fast_bits if arbitration_id & BIT_RATE_SWITCH_FLAG else 0
    return FrameLength(bits, arbitration_bits, fast)


def warm() -> None:
    """Compile, or load from the cache, what counts the bits of frames."""
    frame_bits(0, b"\0")
    stuff(0, np.frombuffer(b"\0", np.uint8))


def frame_bit_sequence(arbitration_id: int, data: bytes) -> list[int]:
    """Return all bits of a frame as sent, stuffed, up to the end of frame; acknowledged.

    For the rare cases which need single bits (two nodes with one id). `frame_length` says how long
    each of them takes.
    """
    if arbitration_id <= CLASSIC_MAX:
        return classic_bit_sequence(arbitration_id, data)
    bits = [*_arbitration_bits(arbitration_id), *_control_bits(arbitration_id, len(data))]
    for byte in data:
        bits += _bits(byte, 8)
    sent: list[int] = []
    state = 0
    for bit in bits[:-1]:
        stuffed, state = stuff_step(state, bit)
        sent += (bit, 1 - bit) if stuffed else (bit,)
    sent.append(bits[-1])
    count = _bits(_STUFF_COUNTS[(len(sent) - len(bits)) % 8], _STUFF_COUNT_BITS)
    width = 17 if len(data) <= CRC17_MAX_LENGTH else 21
    polynomial = CRC17_POLYNOMIAL if width == 17 else CRC21_POLYNOMIAL
    crc = checksum([*sent, *count], width, polynomial, 1 << width - 1)
    for number, bit in enumerate([*count, *_bits(crc, width)]):
        if number % 4 == 0:
            sent.append(1 - sent[-1])
        sent.append(bit)
    return sent + [1, 0] + [1] * 8


_headers: dict[int, tuple[int, int, int]] = {}
"""Results of `_header`, by the id shifted by seven bits and the length."""


def _header(key: int) -> tuple[int, int, int]:
    """Return bits up to BRS, further bits of a frame with constant data, state after the header.

    The second number includes all up to the CRC delimiter but the stuff bits of the data. The
    result is cached.
    """
    arbitration_id, length = key >> 7, key & 0x7F
    state, counts = 0, []
    control = _control_bits(arbitration_id, length)
    # Without data, no stuff bit follows the last bit of the header.
    for part in (_arbitration_bits(arbitration_id), control if length else control[:-1]):
        count = len(part)
        for bit in part:
            stuffed, state = stuff_step(state, bit)
            count += stuffed
        counts.append(count)
    crc_field = _STUFF_COUNT_BITS + (17 if length <= CRC17_MAX_LENGTH else 21)
    fixed_stuff_bits = -(-crc_field // 4)
    fast_bits = counts[1] + (length == 0) + 8 * length + crc_field + fixed_stuff_bits + 1
    known = counts[0], fast_bits, state
    if len(_headers) < 0x10000:
        _headers[key] = known
    return known


def _arbitration_bits(arbitration_id: int) -> list[int]:
    """Return the unstuffed bits from start of frame to BRS (0 dominant)."""
    switch = 1 if arbitration_id & BIT_RATE_SWITCH_FLAG else 0
    if arbitration_id & EXTENDED_FLAG:
        plain = arbitration_id & EXTENDED_MASK
        identifier = [*_bits(plain >> 18, 11), 1, 1, *_bits(plain & 0x3FFFF, 18)]  # SRR, IDE
        return [0, *identifier, 0, 1, 0, switch]  # RRS, FDF, res
    return [0, *_bits(arbitration_id & STANDARD_MASK, 11), 0, 0, 1, 0, switch]  # RRS, IDE, FDF, res


def _control_bits(arbitration_id: int, length: int) -> list[int]:
    """Return ESI and data length code."""
    error_state = 1 if arbitration_id & ERROR_STATE_FLAG else 0
    return [error_state, *_bits(FD_LENGTHS.index(length), 4)]


def _bits(value: int, width: int) -> list[int]:
    """Return the bits of a number, most significant first."""
    return [value >> shift & 1 for shift in range(width - 1, -1, -1)]
