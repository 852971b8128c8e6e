"""The flight recorder: the last minute of the control loop, in memory that outlives its process.

The loop writes into a ring file on tmpfs through a shared mapping. That costs no system call and
never waits: the pages are filled before the loop starts, locked by its `mlockall`, and have no
disk behind them. (A mapped file on a disk would be write-protected page by page as the kernel
writes it back, and the loop's next store there would wait for the disk.) It survives the end of
every process, but no power cut.

The ring is cut into segments, each beginning with a checkpoint of the core, so that the rest can be
replayed after the oldest segment was overwritten. A segment's sequence number is 0 while its
beginning is written; its length moves on when a tick is there as a whole. Both are stored as one
aligned word each, so that a reader in another process, or after a kill between any two
instructions, finds the old value or the new one. (`struct.pack_into` clears the place first and
then writes byte by byte.)
"""

from __future__ import annotations

import mmap
import os
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from robotctl.core.control_core import Inputs, Outputs
from robotctl.errors import LinkError
from robotctl.runtime.flight.recorder import (
    LENGTH,
    Checkpoint,
    RecordError,
    RecordHeader,
    Tick,
    framed,
)
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.runtime.storage.ring_file import leads_to, new_locked, remove_old

SEGMENTS: Final = 16
SEGMENT_SIZE: Final = 1 << 18
"""Size of a segment [bytes]; `SEGMENTS` make a ring of 4 MiB: 60 s at 200 Hz, 12 s at 1 kHz."""

_MAGIC: Final = b"robotctl flight ring 1\n"
_HEAD: Final = struct.Struct("<24sIII")
_HEAD_SIZE: Final = 1 << 16
_SEGMENT_HEAD: Final = struct.Struct("@QQ")
_WORD: Final = _SEGMENT_HEAD.size // 2
_RESERVE: Final = 1 << 15
"""Free space below which a segment is full [bytes]; the longest tick needs less."""


class FlightRing:
    """The writing side, for the control process.

    Parameters
    ----------
    path
        File of the ring, on tmpfs. An existing one is from a process that crashed, and becomes
        `crashed(path)`.
    header
        Header of every record made from the ring.
    checkpoint
        Function that returns the present state of the core.
    segments, segment_size
        Number of segments, and size of each [bytes], a multiple of 8.

    Raises
    ------
    LinkError
        If the file cannot be created, there is no memory for it, or another process writes it.
    """

    def __init__(
        self,
        path: Path,
        header: RecordHeader,
        checkpoint: Callable[[], bytes],
        segments: int = SEGMENTS,
        segment_size: int = SEGMENT_SIZE,
    ) -> None:
        self._path = path
        self._checkpoint = checkpoint
        self._segments, self._segment_size = segments, segment_size
        self._encode = msgspec.msgpack.Encoder().encode
        self._ticks = self._sequence = 0
        self._segment = self._at = self._end = self._mark = 0
        try:
            remove_old(path.parent)
            self._lock = new_locked(path)
            self._memory = self._map(_HEAD_SIZE + segments * segment_size)
        except OSError as error:
            raise LinkError(f"{path}: cannot be created: {error.strerror}") from error
        start = framed(self._encode(header))
        if len(start) > _HEAD_SIZE - _HEAD.size:
            raise LinkError(f"{path}: the configuration has {len(start)} bytes, too many")
        self._memory[_HEAD.size : _HEAD.size + len(start)] = start
        self._begin_segment()
        _HEAD.pack_into(self._memory, 0, b"", segments, segment_size, len(start))
        self._memory[: len(_MAGIC)] = _MAGIC  # last: a reader trusts the rest from now on

    def _map(self, size: int) -> mmap.mmap:
        """Return the ring's memory, with all pages present."""
        try:
            # Reserve the pages now: on a full tmpfs a later write would end the process with
            # SIGBUS.
            os.posix_fallocate(self._lock, 0, size)
            memory = mmap.mmap(self._lock, size)
        except OSError:
            self._path.unlink(missing_ok=True)
            os.close(self._lock)
            raise
        # Touch every page, so that the loop takes no page fault.
        memory[:] = bytes(size)
        self._words = memoryview(memory).cast("Q")
        return memory

    def record(
        self, now_ns: int, inputs: Inputs, outputs: Outputs, lag_ns: int, step_ns: int
    ) -> None:
        """Add one tick, 2 us; one tick in some hundreds also saves the core's state."""
        payload = self._encode(Tick(now_ns, inputs, outputs, lag_ns, step_ns))
        self._ticks += 1
        at, memory = self._at, self._memory
        start = at + LENGTH.size
        end = start + len(payload)
        if end <= self._end:
            # The mark moves last, so a reader never sees half a tick.
            LENGTH.pack_into(memory, at, len(payload))
            memory[start:end] = payload
            self._at = end
            self._words[self._mark] = end - self._segment
        if self._end - self._at < _RESERVE or end > self._end:
            self._begin_segment()

    def _begin_segment(self) -> None:
        """Overwrite the oldest segment with a new one that begins with a checkpoint."""
        core = b""
        if self._ticks:
            try:
                core = self._checkpoint()
            except (pickle.PicklingError, TypeError, AttributeError):
                core = b""  # better no state in the record than no control loop
        memory = self._memory
        self._segment = _HEAD_SIZE + (self._sequence % self._segments) * self._segment_size
        self._end = self._segment + self._segment_size
        self._mark = self._segment // _WORD + 1
        self._words[self._mark - 1] = 0
        self._sequence += 1
        message = framed(self._encode(Checkpoint(self._ticks, core)))
        start = self._segment + _SEGMENT_HEAD.size
        self._at = start + len(message)
        memory[start : self._at] = message
        self._words[self._mark] = self._at - self._segment
        self._words[self._mark - 1] = self._sequence

    def close(self) -> None:
        """Remove the ring at an orderly end; open readers keep it."""
        self._path.unlink(missing_ok=True)
        self._let_go()

    def _let_go(self) -> None:
        """Release memory and lock, like the kernel at the end of the process."""
        self._words.release()
        self._memory.close()
        os.close(self._lock)


class Part(NamedTuple):
    """Whole messages of one segment."""

    sequence: int
    offset: int
    """Offset in the segment [bytes]."""
    data: bytes

    @property
    def begins_segment(self) -> bool:
        """Whether the first message is the segment's checkpoint."""
        return self.offset == _SEGMENT_HEAD.size


class RingReader:
    """The reading side, for any process, while the ring is written or after.

    Parameters
    ----------
    path
        File of the ring.

    Raises
    ------
    RecordError
        If it is missing or not a ring.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
        head = os.pread(self._descriptor, _HEAD.size, 0)
        magic, self._segments, self._segment_size, length = (
            _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0, 0, 0)
        )
        if magic.rstrip(b"\0") != _MAGIC:
            os.close(self._descriptor)
            raise RecordError(f"{path}: not a flight ring, or one being created")
        self.header: bytes = os.pread(self._descriptor, length, _HEAD.size)

    def replaced(self) -> bool:
        """Return whether the path now leads elsewhere: the process ended or restarted."""
        return not leads_to(self.path, self._descriptor)

    def read(self, after: Part | None = None) -> list[Part]:
        """Return the content of the ring, or the part after the one given, oldest first.

        A segment that begins meanwhile waits for the next call; otherwise late ticks of the
        previous one would be skipped.
        """
        done = after.sequence if after is not None else 1
        places = [_HEAD_SIZE + index * self._segment_size for index in range(self._segments)]
        begun = sorted((self._segment_head(place)[0], place) for place in places)
        parts = []
        for sequence, place in begun:
            begin = _SEGMENT_HEAD.size
            if after is not None and sequence == done:
                begin = after.offset + len(after.data)
            now, used = self._segment_head(place)
            if sequence < done or now != sequence or used <= begin:
                continue
            data = os.pread(self._descriptor, used - begin, place + begin)
            if self._segment_head(place)[0] == sequence:
                parts.append(Part(sequence, begin, data))
        return parts

    def _segment_head(self, place: int) -> tuple[int, int]:
        """Return sequence number and length of a segment."""
        sequence, used = _SEGMENT_HEAD.unpack(os.pread(self._descriptor, _SEGMENT_HEAD.size, place))
        return sequence, used

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def dump_size(ring: Path) -> int:
    """Return the present length of a dump of a ring [bytes].

    Raises
    ------
    RecordError
        If the ring cannot be read.
    """
    reader = RingReader(ring)
    try:
        return len(reader.header) + sum(len(part.data) for part in reader.read())
    finally:
        reader.close()


def dump(ring: Path, target: Path) -> None:
    """Write a ring as a record; the target appears once it is complete and on the disk.

    Raises
    ------
    RecordError
        If the ring cannot be read.
    OSError
        If the target cannot be written.
    """
    reader = RingReader(ring)
    try:
        parts = reader.read()
        with part_file(target) as file:
            file.write(reader.header)
            for part in parts:
                file.write(part.data)
    finally:
        reader.close()
