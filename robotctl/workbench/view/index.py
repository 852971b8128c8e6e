"""Messages of a run by topic and time, read chunk by chunk where they are asked for."""

from __future__ import annotations

import os
import struct
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from io import BytesIO
from itertools import accumulate
from typing import Final, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.well_known import MessageEncoding

from robotctl.workbench.view.run_files import LogFile

_HEAD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_KEPT_CHUNKS: Final = 16
_DAMAGE: Final = (McapError, zstandard.ZstdError, struct.error, ValueError, EOFError, RuntimeError)


class Logged(NamedTuple):
    """Message of a topic, as it was logged, at its time [ns]."""

    log_ns: int
    data: bytes


class _Place(NamedTuple):
    """Position of a chunk, and its first and last time [ns]."""

    begin_ns: int
    end_ns: int
    file: int
    offset: int
    length: int


@dataclass(slots=True)
class _Track:
    """Chunks in which a topic has messages, by their first time."""

    places: list[_Place] = field(default_factory=list)
    begins_ns: list[int] = field(default_factory=list)
    latest_ns: list[int] = field(default_factory=list)
    """Last time of a chunk, or of one before it [ns]."""

    def settle(self) -> None:
        """Sort what was added."""
        self.places.sort()
        self.begins_ns = [each.begin_ns for each in self.places]
        self.latest_ns = list(accumulate((each.end_ns for each in self.places), max))


class _Content(NamedTuple):
    """A chunk, uncompressed, and time and place of its messages by topic."""

    data: bytes
    messages: dict[str, list[tuple[int, int, int]]]


class RunIndex:
    """The messages of a run.

    Reads from any thread. What is damaged in a chunk is as if it were not there.

    Parameters
    ----------
    files
        Files of the run.
    stack
        Closes them.

    Attributes
    ----------
    begin_ns, end_ns
        Times of the first state of the control process and the last message [ns]: maps that are
        logged with it may be much older.
    """

    def __init__(self, files: Sequence[LogFile], stack: ExitStack) -> None:
        self._descriptors = []
        self._topics: list[dict[int, str]] = []
        self._tracks: dict[str, _Track] = {}
        self._kept: OrderedDict[_Place, _Content] = OrderedDict()
        for number, file in enumerate(files):
            self._descriptors.append(stack.enter_context(file.path.open("rb")).fileno())
            topics = {
                each.id: each.topic
                for each in file.summary.channels.values()
                if each.message_encoding == MessageEncoding.JSON
            }
            self._topics.append(topics)
            for chunk in file.summary.chunk_indexes:
                place = _Place(
                    chunk.message_start_time,
                    chunk.message_end_time,
                    number,
                    chunk.chunk_start_offset,
                    chunk.chunk_length,
                )
                for channel in chunk.message_index_offsets:
                    if channel in topics:
                        self._tracks.setdefault(topics[channel], _Track()).places.append(place)
        for track in self._tracks.values():
            track.settle()
        self.end_ns = max(each.end_ns for each in files)
        states = (logged.log_ns for _, logged in self.scan(("control",)))
        self.begin_ns = next(states, self.end_ns)

    @property
    def topics(self) -> Collection[str]:
        """Topics that have messages."""
        return self._tracks.keys()

    def newest(self, topic: str, at_ns: int) -> Logged | None:
        """Return the newest message of a topic at a time; None: there is none so far."""
        track = self._tracks.get(topic)
        if track is None:
            return None
        found: tuple[int, _Content, int, int] | None = None
        for number in range(bisect_right(track.begins_ns, at_ns) - 1, -1, -1):
            if found is not None and track.latest_ns[number] <= found[0]:
                break
            content = self._content(track.places[number])
            at, begin, end = max(
                (each for each in content.messages.get(topic, ()) if each[0] <= at_ns),
                default=(-1, 0, 0),
            )
            if at >= 0 and (found is None or at > found[0]):
                found = at, content, begin, end
        return None if found is None else Logged(found[0], found[1].data[found[2] : found[3]])

    def scan(self, topics: Collection[str]) -> Iterator[tuple[str, Logged]]:
        """Yield all messages of some topics, in the order of the log."""
        tracks = (self._tracks.get(each) for each in topics)
        for place in sorted({each for track in tracks if track for each in track.places}):
            content = self._read(place)
            found = [
                (log_ns, begin, end, topic)
                for topic in topics
                for log_ns, begin, end in content.messages.get(topic, ())
            ]
            for log_ns, begin, end, topic in sorted(found):
                yield topic, Logged(log_ns, content.data[begin:end])

    def _content(self, place: _Place) -> _Content:
        """Return a chunk, one of the last that were read or read now."""
        content = self._kept.pop(place, None) or self._read(place)
        self._kept[place] = content
        while len(self._kept) > _KEPT_CHUNKS:
            self._kept.popitem(last=False)
        return content

    def _read(self, place: _Place) -> _Content:
        """Read a chunk."""
        try:
            raw = os.pread(self._descriptors[place.file], place.length, place.offset)
            opcode, length = _HEAD.unpack_from(raw)
            if opcode != Opcode.CHUNK or length != len(raw) - _HEAD.size:
                raise ValueError("no chunk where the index says")
            chunk = Chunk.read(ReadDataStream(BytesIO(raw[_HEAD.size :])))
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data = bytes(stream.read(size))
            return _Content(data, _messages(data, self._topics[place.file]))
        except _DAMAGE:
            return _Content(b"", {})


def _messages(data: bytes, topics: dict[int, str]) -> dict[str, list[tuple[int, int, int]]]:
    """Return time, begin and end of the messages in a chunk by topic."""
    found: dict[str, list[tuple[int, int, int]]] = {}
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if opcode == Opcode.MESSAGE:
            channel, _, log_ns, _ = _MESSAGE.unpack_from(data, at)
            if channel in topics:
                begin = at + _MESSAGE.size
                found.setdefault(topics[channel], []).append((log_ns, begin, at + length))
        at += length
    return found
