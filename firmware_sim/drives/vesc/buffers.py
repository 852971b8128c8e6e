"""Packets longer than a frame, as VESC's firmware takes and sends them (`comm_can.c`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

FILL, FILL_LONG, PROCESS, PROCESS_SHORT = 5, 6, 7, 8
BUFFERS: Final = 3
SIZE: Final = 512


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x1021, most significant bit first, initial value 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


class Buffers:
    """Receiving side: a frame goes to the buffer that is filled up to its offset."""

    def __init__(self) -> None:
        self._content = [bytearray() for _ in range(BUFFERS)]

    def fill(self, offset: int, data: bytes) -> None:
        """Take the data of a filling frame."""
        lengths = [len(content) for content in self._content]
        content = self._content[lengths.index(offset) if offset in lengths else 0]
        if offset + len(data) <= SIZE and len(content) == offset:
            content += data

    def take(self, length: int, crc: int) -> bytes | None:
        """Return the complete packet of this length; clear all buffers if there is none."""
        for content in self._content:
            if len(content) == length:
                packet = bytes(content)
                content.clear()
                return packet if crc16(packet) == crc else None
        for content in self._content:
            content.clear()
        return None


def frames(packet: bytes, own: int) -> Iterator[tuple[int, bytes]]:
    """Yield command and data of the frames that carry an answer."""
    if len(packet) <= 6:
        yield PROCESS_SHORT, bytes((own, 1)) + packet
        return
    place = 0
    while place < len(packet):
        if place < 256:
            yield FILL, bytes((place,)) + packet[place : place + 7]
            place += 7
        else:
            yield FILL_LONG, bytes((place >> 8, place & 0xFF)) + packet[place : place + 6]
            place += 6
    length, crc = len(packet), crc16(packet)
    yield PROCESS, bytes((own, 1, length >> 8, length & 0xFF, crc >> 8, crc & 0xFF))
