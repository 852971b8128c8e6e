"""An append-only file of records, for state too large to rewrite at each change.

Each record has its length and a CRC-32 of both; after a kill or a power cut all complete records
can be read, and an incomplete last one is dropped. Any other mismatch is damage. A thread writes
and syncs, at most twice a second, so that callers never wait for the disk. A file that has doubled
is compacted.
"""

from __future__ import annotations

import io
import os
import queue
import struct
import threading
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from robotctl.errors import DiskError
from robotctl.runtime.storage.atomic_file import write_whole
from robotctl.runtime.storage.ring_file import hold
from robotctl.runtime.storage.state_file import damaged_name

Compacted: TypeAlias = Callable[[Sequence[bytes]], list[bytes]]

_RECORD: Final = struct.Struct("<III")
"""Length of a record [B], its CRC-32, and the CRC-32 of these eight bytes."""
_PERIOD_S: Final = 0.5
_AGAIN_S: Final = 5.0
"""Interval between retries after a refusal of the disk [s]."""
_GROWTH_BYTES: Final = 16 << 20
"""Minimum growth for a compaction [bytes]; the file must also have doubled since the last."""


class DamagedLogError(DiskError):
    """A file is not a log of records, or damaged."""


def packed(records: Sequence[bytes]) -> bytes:
    """Return records encoded for a file."""
    parts = []
    for record in records:
        sizes = struct.pack("<II", len(record), zlib.crc32(record))
        parts += [sizes, struct.pack("<I", zlib.crc32(sizes)), record]
    return b"".join(parts)


def unpacked(content: bytes) -> list[bytes]:
    """Return the complete records of a file's content after its heading.

    Raises
    ------
    ValueError
        If there is anything other than records, the last of which may be incomplete.
    """
    records, at = [], 0
    while len(content) - at >= _RECORD.size:
        length, checksum, own = _RECORD.unpack_from(content, at)
        if zlib.crc32(content[at : at + 8]) != own:
            if content.count(0, at) == len(content) - at:  # grown, but never written: a power cut
                break
            raise ValueError(f"no record begins at byte {at}")
        end = at + _RECORD.size + length
        record = content[at + _RECORD.size : end]
        if zlib.crc32(record) != checksum:
            if end >= len(content):
                break
            raise ValueError(f"the checksum of the record at byte {at} is wrong")
        records.append(record)
        at = end
    return records


def read_records(path: Path, heading: bytes) -> list[bytes]:
    """Return the complete records of a file; none if it is missing.

    Raises
    ------
    DamagedLogError
        If it is not such a file, or damaged.
    DiskError
        If it cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DiskError(f"{path}: cannot be read: {error.strerror}") from error
    if not content.startswith(heading):
        if heading.startswith(content):  # killed before the heading was written
            return []
        raise DamagedLogError(f"{path}: damaged: it does not begin with {heading!r}")
    try:
        return unpacked(content[len(heading) :])
    except ValueError as error:
        raise DamagedLogError(f"{path}: damaged: {error}") from error


def set_aside(path: Path, why: str = "damaged") -> Path:
    """Rename a file to a free name that contains the reason; return that.

    Raises
    ------
    DiskError
        If the disk refuses.
    """
    try:
        taken = {each.name for each in path.parent.iterdir()}
        target = path.with_name(damaged_name(path.name, taken, why))
        return path.rename(target)
    except OSError as error:
        raise DiskError(f"{path}: cannot be set aside: {error.strerror}") from error


class RecordLog:
    """Writes a log of records that begins with those given.

    Parameters
    ----------
    path, heading
        Path of the file, and its first bytes.
    records
        Present records; the file is rewritten with these.
    compacted
        Function that returns fewer records with the same content.

    Raises
    ------
    DiskError
        If it cannot be written, or another process writes it.
    """

    def __init__(
        self, path: Path, heading: bytes, records: Sequence[bytes], compacted: Compacted
    ) -> None:
        self._path = path
        self._heading = heading
        self._compacted = compacted
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with io.FileIO(path, "a+") as before:
                if not hold(before):
                    raise DiskError(f"{path}: another process writes it")
                self._file = self._written(records)
        except OSError as error:
            raise DiskError(f"{path}: cannot be written: {error.strerror}") from error
        self._problem = ""
        self._queue: queue.SimpleQueue[Sequence[bytes] | None] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="record-log", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Reason why the disk refuses the last records; empty: it does not."""
        return self._problem

    def add(self, records: Sequence[bytes]) -> None:
        """Queue records for writing."""
        self._queue.put(records)

    def close(self) -> None:
        """Write queued records, unless the disk refuses, and end."""
        self._closing.set()
        self._queue.put(None)
        self._thread.join()
        self._file.close()

    def _written(self, records: Sequence[bytes]) -> io.FileIO:
        """Rewrite the file; return it open at its end, locked."""
        write_whole(self._path, self._heading + packed(records))
        file = io.FileIO(self._path, "a")
        hold(file)
        self._size = self._least = os.fstat(file.fileno()).st_size
        return file

    def _run(self) -> None:
        """Write queued records until closed."""
        pending = b""
        is_last = False
        while not is_last:
            added = [self._queue.get()]
            while not self._queue.empty():
                added.append(self._queue.get())
            is_last = None in added
            pending += packed([record for each in added for record in each or ()])
            while pending:
                try:
                    self._write(pending)
                    pending, self._problem = b"", ""
                    self._compact()
                except OSError as error:
                    self._problem = f"{self._path}: cannot be written: {error.strerror}"
                    if self._closing.wait(_AGAIN_S):
                        break
            self._closing.wait(_PERIOD_S)

    def _write(self, content: bytes) -> None:
        """Append to the file and sync it, after removing the rest of a failed write."""
        os.ftruncate(self._file.fileno(), self._size)
        left = memoryview(content)
        while left:
            left = left[os.write(self._file.fileno(), left) :]
        os.fdatasync(self._file.fileno())
        self._size += len(content)

    def _compact(self) -> None:
        """Rewrite the file if it has grown enough."""
        if self._size <= 2 * self._least + _GROWTH_BYTES:
            return
        records = unpacked(self._path.read_bytes()[len(self._heading) :])
        with self._file:
            self._file = self._written(self._compacted(records))
