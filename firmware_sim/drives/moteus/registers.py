"""Subframes of moteus's frames, as the drive reads and answers them (`docs/protocol/can.md`)."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Final, NamedTuple

INT8, INT16, INT32, FLOAT = range(4)

_FORMATS: Final = tuple(struct.Struct(each) for each in ("<b", "<h", "<i", "<f"))
_MOST: Final = (127, 32767, 2147483647)

WRITE, READ, ANSWER, STREAM_WRITE, STREAM_POLL = 0x00, 0x10, 0x20, 0x40, 0x42
STREAM_ANSWER, READ_ERROR, NOP = 0x41, 0x31, 0x50

TIME: Final = (0.01, 0.001, 0.000001)
_UNITS: Final[dict[int, tuple[float, float, float]]] = {
    0x001: (0.01, 0.0001, 0.00001),
    0x002: (0.1, 0.00025, 0.00001),
    0x003: (0.5, 0.01, 0.001),
    0x004: (1.0, 0.1, 0.001),
    0x00D: (0.5, 0.1, 0.001),
    0x00E: (1.0, 0.1, 0.001),
    0x020: (0.01, 0.0001, 0.00001),
    0x021: (0.1, 0.00025, 0.00001),
    0x025: (0.5, 0.01, 0.001),
    0x027: TIME,
    0x029: (0.05, 0.001, 0.00001),
}
"""Units of registers as integers of 8, 16 and 32 bits; other registers are whole numbers."""


class Write(NamedTuple):
    """A written register; nan for the integer that stands for it."""

    register: int
    value: float


class Read(NamedTuple):
    """Registers to read, in one number format."""

    kind: int
    first: int
    number: int


class StreamWrite(NamedTuple):
    """Data for the diagnostic stream."""

    channel: int
    data: bytes


class StreamPoll(NamedTuple):
    """Request for data of the diagnostic stream, with its maximum length in bytes."""

    channel: int
    most: int


def subframes(data: bytes) -> Iterator[Write | Read | StreamWrite | StreamPoll]:
    """Yield the requests of a frame up to the first unknown or incomplete one."""
    with suppress(IndexError, struct.error):
        yield from _complete(data)


def _complete(data: bytes) -> Iterator[Write | Read | StreamWrite | StreamPoll]:
    """Yield the requests; raises IndexError or struct.error at an incomplete subframe."""
    place = 0
    while place < len(data):
        head = data[place]
        place += 1
        if head == NOP:
            continue
        if head in (STREAM_WRITE, STREAM_POLL):
            channel, place = _varuint(data, place)
            size, place = _varuint(data, place)
            if head == STREAM_POLL:
                yield StreamPoll(channel, size)
            else:
                yield StreamWrite(channel, data[place : place + size])
                place += size
            continue
        if head & 0xF0 not in (WRITE, READ):
            return
        kind, count = head >> 2 & 3, head & 3
        if count == 0:
            count, place = _varuint(data, place)
        first, place = _varuint(data, place)
        if head & 0xF0 == READ:
            yield Read(kind, first, count)
            continue
        for register in range(first, first + count):
            (raw,) = _FORMATS[kind].unpack_from(data, place)
            place += _FORMATS[kind].size
            yield Write(register, _from_raw(register, kind, raw))


def answer(read: Read, value: Callable[[int], float | None]) -> bytes:
    """Return the subframe that answers a read; an unknown register is an error."""
    content = b""
    for register in range(read.first, read.first + read.number):
        found = value(register)
        if found is None:
            return bytes((READ_ERROR,)) + _to_varuint(register) + _to_varuint(1)
        content += _FORMATS[read.kind].pack(_to_raw(register, read.kind, found))
    short = read.number <= 3
    head = bytes((ANSWER | read.kind << 2 | (read.number if short else 0),))
    length = b"" if short else _to_varuint(read.number)
    return head + length + _to_varuint(read.first) + content


def _from_raw(register: int, kind: int, raw: float) -> float:
    if kind == FLOAT:
        return raw
    if register in _UNITS:
        return math.nan if raw < -_MOST[kind] else raw * _UNITS[register][kind]
    return raw


def _to_raw(register: int, kind: int, value: float) -> float:
    if kind == FLOAT:
        return value
    if math.isnan(value):
        return -_MOST[kind] - 1
    if register not in _UNITS:
        bits = 8 << kind
        return (int(value) + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)
    return round(min(max(value / _UNITS[register][kind], -_MOST[kind]), _MOST[kind]))


def _varuint(data: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[place]
        place += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, place


def _to_varuint(value: int) -> bytes:
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    found.append(value)
    return bytes(found)
