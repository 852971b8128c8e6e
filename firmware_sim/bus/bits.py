"""Bits of a classic CAN frame on the wire: arbitration order, CRC-15, bit stuffing, length.

Source: ISO 11898-1:2015, clause 10.4 (frame formats), 10.5 (stuffing); Bosch CAN 2.0, part B.

A frame's payload differs from the last one's nearly always (counter, CRC), so caching lengths
does not help. Instead CRC and stuffing are counted bit by bit in machine code, under 1 us a frame;
tables for many bits at a time are too large for a processor's cache.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np

from firmware_sim.bus.frame import (
    EXTENDED_FLAG,
    EXTENDED_MASK,
    MAX_DATA_LENGTH,
    REMOTE_FLAG,
    STANDARD_MASK,
)
from native_kernels.compiled import compiled

CRC15_POLYNOMIAL = 0x4599
"""x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1, initial value 0, no final xor."""

TRAILER_BITS = 10
"""CRC delimiter, acknowledge slot and delimiter, end of frame (7): never stuffed."""
ACK_SLOT_TO_END_BITS = 8
"""Bits from the end of the acknowledge slot to the end of the frame."""
INTERMISSION_BITS = 3
"""Recessive bits between the end of a frame and the next start of frame."""


def arbitration_key(arbitration_id: int) -> int:
    """Return the arbitration field as a number; the lowest of those that compete wins the bus.

    The bits are in the order of the wire, so a standard frame beats an extended one with the
    same 11 leading bits (SRR and IDE are recessive) and data beats a remote request. A frame of
    CAN FD competes as a classic data frame does.
    """
    remote = 1 if arbitration_id & REMOTE_FLAG else 0
    if arbitration_id & EXTENDED_FLAG:
        plain = arbitration_id & EXTENDED_MASK
        return (plain >> 18) << 21 | 0b11 << 19 | (plain & 0x3FFFF) << 1 | remote
    return (arbitration_id & STANDARD_MASK) << 21 | remote << 20


def header_bits(arbitration_id: int, length: int) -> list[int]:
    """Return the unstuffed bits from start of frame to the data length code (0 dominant)."""
    remote = 1 if arbitration_id & REMOTE_FLAG else 0
    if arbitration_id & EXTENDED_FLAG:
        plain = arbitration_id & EXTENDED_MASK
        value, width = (plain >> 18) << 2 | 0b11, 13
        value, width = value << 18 | (plain & 0x3FFFF), width + 18
        value, width = value << 3 | remote << 2, width + 3  # RTR, r1, r0
    else:
        value, width = (arbitration_id & STANDARD_MASK) << 3 | remote << 2, 14  # RTR, IDE, r0
    value, width = value << 4 | length, width + 4
    return [0, *((value >> shift) & 1 for shift in range(width - 1, -1, -1))]


def checksum(bits: Iterable[int], width: int, polynomial: int, initial: int = 0) -> int:
    """Return the CRC of `width` bits of a bit sequence, bit by bit as the standard has it."""
    crc, mask = initial, (1 << width) - 1
    for bit in bits:
        high = crc >> width - 1
        crc = (crc << 1) & mask
        if high != bit:
            crc ^= polynomial
    return crc


def crc15(bits: Iterable[int]) -> int:
    """Return the CRC-15 of a classic frame's bits."""
    return checksum(bits, 15, CRC15_POLYNOMIAL)


def classic_bit_sequence(arbitration_id: int, data: bytes) -> list[int]:
    """Return all bits of a classic frame as sent, stuffed, to the end of frame; acknowledged."""
    payload = b"" if arbitration_id & REMOTE_FLAG else data
    bits = header_bits(arbitration_id, len(data))
    for byte in payload:
        bits += [(byte >> shift) & 1 for shift in range(7, -1, -1)]
    crc = crc15(bits)
    bits += [(crc >> shift) & 1 for shift in range(14, -1, -1)]
    sent: list[int] = []
    state = 0
    for bit in bits:
        sent.append(bit)
        stuffed, state = stuff_step(state, bit)
        if stuffed:
            sent.append(1 - bit)
    return sent + [1, 0] + [1] * 8


def stuff_step(state: int, bit: int) -> tuple[int, int]:
    """Advance the stuffing state by one bit; return (1 where a stuff bit follows, new state).

    State 0: nothing sent yet; 1..4: number of equal dominant bits; 5..8: of recessive ones.
    """
    first = 1 + 4 * bit
    if first <= state < first + 4:
        if state == first + 3:  # the fifth equal bit: its complement is inserted
            return 1, 1 + 4 * (1 - bit)
        return 0, state + 1
    return 0, first


@compiled
def _stuff_bits(crc: int, state: int, high: int, low: int, width: int) -> int:
    """Return how many stuff bits `width` bits of data, and the CRC-15 behind them, bring about.

    `high` has the bits of the data above the lowest 32, which are `low`; `crc` and `state` are
    those behind the header.
    """
    count = 0
    for place in range(width + 14, -1, -1):
        if place >= 15:
            shift = place - 15
            bit = high >> shift - 32 & 1 if shift >= 32 else low >> shift & 1
            crc = (crc << 1 & 0x7FFF) ^ (CRC15_POLYNOMIAL if crc >> 14 != bit else 0)
        else:
            bit = crc >> place & 1
        first = 1 + 4 * bit
        if state == first + 3:  # as in `stuff_step`
            count += 1
            state = 1 + 4 * (1 - bit)
        elif first <= state < first + 3:
            state += 1
        else:
            state = first
    return count


@compiled
def stuff(state: int, data: np.ndarray) -> int:
    """Return stuff bits << 4 | new state of data, as bytes, that follow a stuffing state."""
    count = 0
    for byte in data:
        for shift in range(7, -1, -1):
            bit = int(byte) >> shift & 1
            first = 1 + 4 * bit
            if state == first + 3:
                count += 1
                state = 1 + 4 * (1 - bit)
            elif first <= state < first + 3:
                state += 1
            else:
                state = first
    return count << 4 | state


_UNPACK_WORDS = struct.Struct(">2I").unpack
_headers: dict[int, tuple[int, int, int, int]] = {}
"""Results of `_header`, by the id shifted by four bits and the length."""


def _header(arbitration_id: int, length: int) -> tuple[int, int, int, int]:
    """Return CRC-15 and stuffing state after the header, data bits, and bits of the whole frame.

    The last without the stuff bits behind the header, unless there is no data to change them. The
    result is kept for the next time.
    """
    bits = header_bits(arbitration_id, length)
    state, count = 0, len(bits)
    for bit in bits:
        stuffed, state = stuff_step(state, bit)
        count += stuffed
    crc, width = crc15(bits), 0 if arbitration_id & REMOTE_FLAG else 8 * length
    count += width + 15 + TRAILER_BITS
    if not width:
        count += _stuff_bits(crc, state, 0, 0, 0)
    known = crc, state, width, count
    if len(_headers) < 0x10000:
        _headers[arbitration_id << 4 | length] = known
    return known


def frame_bits(arbitration_id: int, data: bytes) -> int:
    """Return the length of a classic frame in bit times, start of frame to end of frame.

    Stuffing is counted exactly. The intermission (`INTERMISSION_BITS`) comes on top.

    Parameters
    ----------
    arbitration_id
        Id with flags as in `Frame`.
    data
        0 to 8 bytes; of a remote request only the length counts.
    """
    length = len(data)
    known = _headers.get(arbitration_id << 4 | length)
    crc, state, width, bits = known if known is not None else _header(arbitration_id, length)
    if not width:
        return bits
    if length == MAX_DATA_LENGTH:
        high, low = _UNPACK_WORDS(data)
    else:
        high, low = divmod(int.from_bytes(data, "big"), 1 << 32)
    return bits + _stuff_bits(crc, state, high, low, width)
