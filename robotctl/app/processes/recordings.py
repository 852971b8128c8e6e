"""The folder of `--record` as the page shows it."""

from __future__ import annotations

import errno
import os
import re
import stat
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics

from robotctl.runtime.storage.ring_file import is_written
from robotctl.web.recordings import RecordedFile

_NAME: Final = re.compile(
    r"(control|can|robot|simulator|truth|map)-\d{4,}\.(rec|log|mcap|tum|yaml|pgm)(\.damaged-\d+)?"
    r"|(fault|crash)-[\w.-]+\.rec|exits\.jsonl"
)
"""Names of what the recorder and others beside it write: nothing else of the folder is shown."""
_CHUNK_NS: Final = 1_000_000_000
"""Length of a chunk of a log of states [ns]."""
_HEAD: Final = struct.Struct("<BQ")
_FOOTER: Final = struct.Struct("<BQQQI")
_MAGIC: Final = b"\x89MCAP0\r\n"
"""End of a complete file; the package's writer, which has it too, loads its compressors."""
_MOST_INDEX: Final = 1 << 24
"""Largest index that is read [B]: that of a file of 4 GB has a tenth of it."""


class _Key(NamedTuple):
    name: str
    size: int
    modified_ns: int


class RecordingFolder:
    """Recordings of a robot.

    Parameters
    ----------
    folder
        Where they are; it need not exist.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._spans: dict[_Key, tuple[float, float] | None] = {}

    def list(self) -> Sequence[RecordedFile]:
        """Return the files, the newest first; raises OSError."""
        if not self._folder.exists():
            return ()
        spans: dict[_Key, tuple[float, float] | None] = {}
        found = []
        with os.scandir(self._folder) as entries:
            for entry in entries:
                if not _NAME.fullmatch(entry.name) or not entry.is_file(follow_symlinks=False):
                    continue
                status = entry.stat(follow_symlinks=False)
                key = _Key(entry.name, status.st_size, status.st_mtime_ns)
                path = self._folder / entry.name
                spans[key] = self._spans[key] if key in self._spans else _span(path)
                begin_s, end_s = spans[key] or (None, None)
                written = is_written(path)
                modified_s = status.st_mtime_ns / 1e9
                found.append(
                    RecordedFile(entry.name, status.st_size, modified_s, begin_s, end_s, written)
                )
        self._spans = spans
        return sorted(found, key=lambda each: (-each.modified_s, each.name))

    def open(self, name: str) -> int:
        """Return a descriptor of a file of the list; raises OSError."""
        if not _NAME.fullmatch(name):
            raise FileNotFoundError(name)
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            descriptor = os.open(self._folder / name, flags)
        except OSError as error:
            if error.errno == errno.ELOOP:  # a link, which may lead anywhere
                raise FileNotFoundError(name) from error
            raise
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise FileNotFoundError(name)
        return descriptor


def _span(path: Path) -> tuple[float, float] | None:
    """Return first and last time of an MCAP file [s]; None: it has none, or no index yet."""
    if path.suffix != ".mcap":
        return None
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            end = size - _FOOTER.size - len(_MAGIC)
            file.seek(max(0, end))
            opcode, _, begin, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
            if opcode != Opcode.FOOTER or file.read() != _MAGIC:
                return None
            if not 0 < begin <= end or end - begin > _MOST_INDEX:
                return None
            file.seek(begin)
            begin_ns = end_ns = None
            while (begin_ns is None or end_ns is None) and file.tell() + _HEAD.size <= end:
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                place = file.tell()
                if opcode == Opcode.STATISTICS:
                    end_ns = Statistics.read(ReadDataStream(file)).message_end_time
                elif opcode == Opcode.CHUNK_INDEX:
                    # Its first message may be a map that is much older.
                    first = ChunkIndex.read(ReadDataStream(file))
                    begin_ns = max(first.message_start_time, first.message_end_time - _CHUNK_NS)
                file.seek(place + length)
            if begin_ns is not None and end_ns is not None:
                return begin_ns / 1e9, end_ns / 1e9
    except (OSError, struct.error, ValueError, EOFError):
        return None
    return None
