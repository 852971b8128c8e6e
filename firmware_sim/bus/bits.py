"""Bits of a classic CAN frame on the wire: arbitration order, CRC-15, bit stuffing, length.

Source: ISO 11898-1:2015, clause 10.4 (frame formats), 10.5 (stuffing); Bosch CAN 2.0, part B.

A frame's payload differs from the last one's nearly always (counter, CRC), so caching lengths
does not help. Instead CRC and stuffing go through tables 16 bits at a time, under 1 us a frame.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterable

from firmware_sim.bus.frame import (
    EXTENDED_FLAG,
    EXTENDED_MASK,
    MAX_DATA_LENGTH,
    REMOTE_FLAG,
    STANDARD_MASK,
)

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


def _stuff_table(width: int) -> list[bytes]:
    """Return for each state a row over all words of `width` bits: stuff bits << 4 | new state."""
    rows = []
    for first_state in range(9):
        row = bytearray()
        for word in range(1 << width):
            count, state = 0, first_state
            for shift in range(width - 1, -1, -1):
                stuffed, state = stuff_step(state, (word >> shift) & 1)
                count += stuffed
            row.append(count << 4 | state)
        rows.append(bytes(row))
    return rows


def _doubled_stuff_table(table: list[bytes]) -> list[bytes]:
    """Chain a table into the one for words of twice as many bits."""
    add = [bytes(min(value + (count << 4), 255) for value in range(256)) for count in range(3)]
    return [
        b"".join(table[step & 15].translate(add[step >> 4]) for step in row_of_high)
        for row_of_high in table
    ]


def _crc_table(width: int) -> list[int]:
    """Return the CRC-15 of every word of `width` bits, the register starting at 0."""
    return [
        crc15([(word >> shift) & 1 for shift in range(width - 1, -1, -1)])
        for word in range(1 << width)
    ]


STUFF8 = _doubled_stuff_table(_stuff_table(4))
STUFF16 = _doubled_stuff_table(STUFF8)
"""Stuff bits << 4 | new state, by stuffing state and word of 8 or 16 bits."""
_CRC8 = [crc << 1 for crc in _crc_table(8)]
_CRC8_HIGH = [((crc << 8) & 0xFFFF) ^ _CRC8[crc >> 8] for crc in _CRC8]
_CRC16 = array("H", [high ^ low for high in _CRC8_HIGH for low in _CRC8])
"""CRC-15 << 1 of every word of 8 or 16 bits, the register starting at 0."""

_UNPACK_WORDS = struct.Struct(">4H").unpack
_headers: dict[int, tuple[int, int, int]] = {}
"""Headers by the id, shifted by four bits, and the length."""


def _header(arbitration_id: int, length: int) -> tuple[int, int, int]:
    """Return (CRC-15 << 1, stuffing state, bits sent) after the header; kept for the next time."""
    bits = header_bits(arbitration_id, length)
    state, count = 0, len(bits)
    for bit in bits:
        stuffed, state = stuff_step(state, bit)
        count += stuffed
    known = (crc15(bits) << 1, state, count)
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
    crc, state, bits = known if known is not None else _header(arbitration_id, length)
    if length == MAX_DATA_LENGTH and not arbitration_id & REMOTE_FLAG:
        crc_of, stuff = _CRC16, STUFF16
        a, b, c, d = _UNPACK_WORDS(data)
        crc = crc_of[crc_of[crc_of[crc_of[crc ^ a] ^ b] ^ c] ^ d]
        a = stuff[state][a]
        b = stuff[a & 15][b]
        c = stuff[b & 15][c]
        d = stuff[c & 15][d]
        bits += (a >> 4) + (b >> 4) + (c >> 4) + (d >> 4) + 64
        state = d & 15
    elif not arbitration_id & REMOTE_FLAG:
        for byte in data:
            crc = ((crc << 8) & 0xFFFF) ^ _CRC8[(crc >> 8) ^ byte]
            step = STUFF8[state][byte]
            bits += 8 + (step >> 4)
            state = step & 15
    # A sixteenth bit that differs from the one before it adds no stuff bit.
    return bits + (STUFF16[state][crc | ~crc >> 1 & 1] >> 4) + (15 + TRAILER_BITS)
