"""The complete records of an MCAP file, and where it was cut or damaged.

After damage, reading continues at the next valid chunk: its lengths agree, it decompresses, and its
CRC-32 is right. Records between chunks carry no checksum; they count as damaged if their kind is
unknown or not expected there, or their length does not fit their content. Any bytes can be a
message's content, so in a file with chunks a message outside of them counts as a damaged record.

A chunk in which the file ends yields its complete messages, as far as they can be decompressed: no
checksum covers a part of a chunk, so these are trusted.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

_DAMAGE: Final = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    MemoryError,
    OverflowError,  # of lengths beyond 63 bits
    RuntimeError,  # of lz4
)
_RECORD_LIMIT: Final = 1 << 28
_HEAD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")  # times, size, CRC-32; length of the compression's name
_STRING: Final = struct.Struct("<I")
_LENGTHS: Final[dict[int, tuple[struct.Struct, ...]]] = {
    Opcode.HEADER: (_STRING, _STRING),
    Opcode.CHUNK: (_CHUNK, struct.Struct("<Q")),
    Opcode.MESSAGE_INDEX: (struct.Struct("<HI"),),
}
"""Fields before each variable part of a record, with its length last."""

_BLOCK: Final = 1 << 20
_KINDS: Final[dict[int, type[Header | Schema | Channel | Attachment | Metadata]]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
}


_OF_CHUNKS: Final[dict[int, Any]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
}

_SECTOR: Final = 4096
_DECOMPRESSORS: Final[dict[str, Callable[[], Callable[[bytes], bytes]]]] = {
    "zstd": lambda: zstandard.ZstdDecompressor().decompressobj().decompress,
    "lz4": lambda: lz4.frame.LZ4FrameDecompressor().decompress,
}
"""Incremental decompressors."""


@dataclass(frozen=True, slots=True)
class Gap:
    """An unreadable part of a log.

    Parameters
    ----------
    begin
        Offset of its first byte.
    length
        Number of bytes; 0 if a log was cut between two records.
    is_cut
        Whether it is the end of a log that was cut short.
    lost
        Lost bytes of content before compression; 0 if the gap never held any: between records, in
        an index, or in zeros left by a power cut.
    """

    begin: int
    length: int
    is_cut: bool
    lost: int


def whole_records(source: BinaryIO) -> Iterator[McapRecord | Gap]:
    """Yield the records of a log up to the end of its data, and the gaps between them.

    The last is a gap where the log was not closed.
    """
    size = source.seek(0, io.SEEK_END)
    place = len(MCAP0_MAGIC)
    has_chunks = _next_chunk(source, place, size) < size
    while True:
        try:
            opcode, end = _extent(source, place, size)
            if opcode == Opcode.DATA_END:
                return
            if opcode == Opcode.MESSAGE and has_chunks:
                raise ValueError("a message outside of the chunks")
            if (opcode == Opcode.HEADER) != (place == len(MCAP0_MAGIC)):
                raise ValueError("a log has one heading, and begins with it")
            records = _records(source, opcode, place, end)
        except _DAMAGE as error:
            end = _next_chunk(source, place + 1, size)
            if end == size and _is_cut(source, place, size, error):
                yield from _cut_end(source, place, size)
                return
            yield Gap(place, end - place, is_cut=False, lost=end - place)
            if end == size:
                return
        else:
            yield from records
        place = end


def _extent(source: BinaryIO, place: int, size: int) -> tuple[int, int]:
    """Return kind and end of the record that begins at a place.

    Raises
    ------
    EOFError
        If the file ends within it.
    ValueError
        If no record begins there.
    """
    source.seek(place)
    head = source.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise EOFError
    opcode, length = _HEAD.unpack(head)
    if length > _RECORD_LIMIT:
        raise ValueError("too long")
    if opcode in _LENGTHS:
        _check_lengths(source, opcode, length)
    elif opcode == Opcode.DATA_END:
        if length != 4:
            raise ValueError("no end of the data")
    elif opcode not in _KINDS and opcode != Opcode.MESSAGE:
        raise ValueError("no record of the data section")
    end = place + _HEAD.size + length
    if end > size:
        raise EOFError
    return opcode, end


def _check_lengths(source: BinaryIO, opcode: int, length: int) -> None:
    """Refuse a record, read up to its head, whose lengths contradict each other."""
    total = 0
    for part in _LENGTHS[opcode]:
        head = source.read(part.size)
        if len(head) < part.size:
            raise EOFError
        *_, inner = part.unpack(head)
        total += part.size + inner
        if total > length:
            break
        source.seek(inner, io.SEEK_CUR)
    if total != length:
        raise ValueError("the lengths of a record contradict each other")


def _records(source: BinaryIO, opcode: int, place: int, end: int) -> list[McapRecord]:
    """Return a record, or those in a chunk; raises one of `_DAMAGE`."""
    source.seek(place + _HEAD.size)
    length = end - place - _HEAD.size
    stream = ReadDataStream(io.BytesIO(source.read(length)))
    if opcode == Opcode.CHUNK:
        return _opened(Chunk.read(stream))
    if opcode == Opcode.MESSAGE:
        return [Message.read(stream, length)]
    if opcode == Opcode.MESSAGE_INDEX:  # not needed, and slow to take apart
        return []
    record: McapRecord = _KINDS[opcode].read(stream)
    if stream.count != length:
        raise ValueError("its length does not fit its content")
    return [record]


def _opened(chunk: Chunk) -> list[McapRecord]:
    """Return the records in a chunk, without trusting its claimed sizes."""
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        sizes.append(zstandard.frame_content_size(chunk.data))
    if max(sizes) > _RECORD_LIMIT:
        raise ValueError("too long")
    return breakup_chunk(chunk, validate_crc=True)


def _next_chunk(source: BinaryIO, place: int, size: int) -> int:
    """Return the offset of the next valid chunk; the end of the file without one."""
    while place < size:
        source.seek(place)
        block = source.read(_BLOCK)
        at = block.find(Opcode.CHUNK)
        while at >= 0:
            if _is_proven(source, place + at, size):
                return place + at
            at = block.find(Opcode.CHUNK, at + 1)
        place += len(block)
    return size


def _is_proven(source: BinaryIO, place: int, size: int) -> bool:
    """Return whether a complete chunk with a valid checksum begins at an offset."""
    try:
        opcode, end = _extent(source, place, size)
        _records(source, opcode, place, end)
        source.seek(place + _HEAD.size)
        *_, crc, _ = _CHUNK.unpack(source.read(_CHUNK.size))
    except _DAMAGE:
        return False
    return bool(crc)  # 0 stands for none


def _is_cut(source: BinaryIO, place: int, size: int, error: BaseException) -> bool:
    """Return whether the rest of a file, without a chunk, is typical of a kill or power cut.

    Typical are the beginning of a record, or only zeros, whose data had not reached the disk.
    """
    closing = size - len(MCAP0_MAGIC)
    if closing >= place:
        source.seek(closing)
        if source.read() == MCAP0_MAGIC:
            return False
    return isinstance(error, EOFError) or _is_blank(source, place)


def _is_blank(source: BinaryIO, place: int) -> bool:
    """Return whether a file has only zeros from an offset on."""
    source.seek(place)
    return all(not any(block) for block in iter(lambda: source.read(_BLOCK), b""))


def _cut_end(source: BinaryIO, place: int, size: int) -> Iterator[McapRecord | Gap]:
    """Yield the complete records within the last, cut one, and the gap after them."""
    source.seek(place)
    opcode = next(iter(source.read(1)), None)
    rest = size - place
    if rest <= _HEAD.size or opcode == Opcode.MESSAGE_INDEX or _is_blank(source, place):
        yield Gap(place, rest, is_cut=True, lost=0)
        return
    records: list[McapRecord] = []
    lost = rest
    if opcode == Opcode.CHUNK:
        with suppress(*_DAMAGE):
            records, lost = _of_cut_chunk(source, place)
    yield from records
    yield Gap(place, rest, is_cut=True, lost=lost)


def _of_cut_chunk(source: BinaryIO, place: int) -> tuple[list[McapRecord], int]:
    """Return the complete records of a chunk in which the file ends, and the number of lost bytes.

    Raises one of `_DAMAGE`.
    """
    source.seek(place + _HEAD.size)
    _, _, uncompressed, _, length = _CHUNK.unpack(source.read(_CHUNK.size))
    if uncompressed > _RECORD_LIMIT:
        raise ValueError("too long")
    compression = source.read(length).decode()
    source.seek(8, io.SEEK_CUR)  # the length of the data, which the file does not have
    records, used = _whole_in(_beginning(compression, source.read()))
    return records, max(uncompressed - used, 1)


def _beginning(compression: str, data: bytes) -> bytes:
    """Return the readable beginning of a chunk's compressed content."""
    if not compression:
        kept = data.rstrip(b"\0")
        # Messages may end with a few zeros; more of them had not reached the disk.
        return data if len(data) - len(kept) < _SECTOR else kept
    content = b""
    with suppress(*_DAMAGE):
        decompress = _DECOMPRESSORS[compression]()
        for at in range(0, len(data), _SECTOR):
            content += decompress(data[at : at + _SECTOR])
            if len(content) > _RECORD_LIMIT:
                break
    return content


def _whole_in(content: bytes) -> tuple[list[McapRecord], int]:
    """Return the complete records at the beginning of a chunk's content, and their length."""
    records: list[McapRecord] = []
    at = 0
    while at + _HEAD.size <= len(content):
        opcode, length = _HEAD.unpack_from(content, at)
        end = at + _HEAD.size + length
        if opcode not in _OF_CHUNKS or end > len(content):
            break
        stream = ReadDataStream(io.BytesIO(content[at + _HEAD.size : end]))
        try:
            if opcode == Opcode.MESSAGE:
                records.append(Message.read(stream, length))
            else:
                records.append(_OF_CHUNKS[opcode].read(stream))
        except _DAMAGE:
            break
        at = end
    return records, at
