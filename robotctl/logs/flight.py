"""The recorder's use of the flight ring: continuous records, and dumps on faults."""

from __future__ import annotations

import datetime as dt
import errno
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from robotctl.messages.control import ControlState
from robotctl.runtime.flight.recorder import RecordError
from robotctl.runtime.flight.ring import Part, RingReader, dump, dump_size
from robotctl.runtime.storage.atomic_file import remove_parts
from robotctl.runtime.storage.log_folder import LogFolder, age_rank, close_log, is_gone
from robotctl.runtime.storage.ring_file import crashed, leads_to
from robotctl.safety.state_machine import LATCHED

AFTERMATH_NS: Final = 1_000_000_000
"""Delay of a dump after the fault, to record its consequences [ns]."""

MOST_DUMPS: Final = 20
"""Maximum number of dumps; older ones are removed."""

RETRY_NS: Final = 10_000_000_000
"""Time until a crash dump that the disk refused is retried [ns]."""

_KINDS: Final = ("fault", "crash")
_FULL: Final = (errno.ENOSPC, errno.EDQUOT)


class RecordCopy:
    """Copies the ring, while it is being written, into records `control-0001.rec` and so on.

    A copy begins with the oldest available segment, so a restarted recorder repeats some ticks and
    loses none; so does a copy whose file was removed.

    Parameters
    ----------
    ring
        File of the ring, which may appear, disappear and be replaced.
    folder
        Folder of the records.
    """

    def __init__(self, ring: Path, folder: LogFolder) -> None:
        self._ring = ring
        self._folder = folder
        self._reader: RingReader | None = None
        self._last: Part | None = None
        self._file: BinaryIO | None = None

    def step(self) -> None:
        """Copy new ticks.

        Raises
        ------
        OSError
            If the disk refuses; after `close` a retry is possible, which loses only what the ring
            has overwritten meanwhile.
        """
        if self._file is not None and is_gone(self._file):
            self.close()
        if self._reader is None:
            try:
                self._reader = RingReader(self._ring)
            except RecordError:
                return
        ended = self._reader.replaced()
        for part in self._reader.read(self._last):
            file = self._file
            if file is None or (part.begins_segment and file.tell() > self._folder.file_bytes):
                file = self._begin(self._reader.header)
            file.write(part.data)
            self._last = part
        if self._file is not None:
            self._file.flush()
        if ended:
            self.close()

    def _begin(self, header: bytes) -> BinaryIO:
        """Begin the next file."""
        if self._file is not None:
            self._file.close()
        self._file = self._folder.open("control", "rec")
        self._file.write(header)
        return self._file

    def close(self) -> None:
        """Release ring and file; raises OSError if the disk refuses."""
        reader, file = self._reader, self._file
        self._reader, self._last, self._file = None, None, None
        if reader is not None:
            reader.close()
        if file is not None:
            close_log(file)


class FlightDumps:
    """Writes the ring to a file after faults and crashes.

    `fault-TIME.rec` follows a fault or an emergency stop, `crash-TIME.rec` a crash of the control
    process. On a full disk the oldest dumps make room for a new one, but no more of them than
    needed. The ring of a crash stays in memory until the disk accepts it.

    Parameters
    ----------
    ring
        File of the ring.
    directory
        Folder of the dumps, made if missing. Incomplete dumps of a dead recorder are removed there.
    """

    def __init__(self, ring: Path, directory: Path) -> None:
        self._ring = ring
        self._directory = directory
        self._latched = False
        self._newest: int | None = None
        """Descriptor of the newest ring: a control process that ends removes its path, and its last
        fault may be heard afterwards."""
        self._fault: int | None = None
        """Descriptor of the ring of the fault to be dumped."""
        self._due_ns: int | None = None
        self._retry_ns: int | None = None
        for kind in _KINDS:
            remove_parts(directory, f"{kind}-*.rec")

    def step(self, messages: Sequence[object], now_ns: int) -> tuple[str, ...]:
        """Take published messages; return a sentence for each dump or its failure."""
        self._open_newest()
        for message in messages:
            if isinstance(message, ControlState):
                latched = message.state in LATCHED
                if latched and not self._latched and self._due_ns is None:
                    self._due_ns, self._fault = now_ns + AFTERMATH_NS, self._newest
                self._latched = latched
        notes: tuple[str, ...] = ()
        if self._retry_ns is None or now_ns >= self._retry_ns:
            notes = self._dump_crash(now_ns)
        if self._due_ns is not None and now_ns >= self._due_ns:
            notes += self._dump_fault()
        return notes

    def close(self) -> tuple[str, ...]:
        """Write pending dumps."""
        notes = self._dump_crash(0)
        if self._due_ns is not None:
            notes += self._dump_fault()
        if self._newest is not None:
            os.close(self._newest)
            self._newest = None
        return notes

    def _open_newest(self) -> None:
        """Open the ring, if it is not the one that is open."""
        before = self._newest
        if before is not None and leads_to(self._ring, before):
            return
        with suppress(OSError):  # none is written now; reported when it is to be read
            self._newest = os.open(self._ring, os.O_RDONLY | os.O_CLOEXEC)
            if before not in (None, self._fault):
                os.close(before)

    def _dump_fault(self) -> tuple[str, ...]:
        """Write the ring of the control process that had the fault."""
        notes: list[str] = []
        ring = self._ring if self._fault is None else Path(f"/proc/self/fd/{self._fault}")
        with suppress(OSError):  # reported in the notes; a retry in a minute would miss the fault
            self._dump(ring, "fault", notes, make_room=True)
        self._forget_fault()
        return tuple(notes)

    def _forget_fault(self) -> None:
        """Wait for no dump of a fault."""
        self._due_ns = None
        if self._fault not in (None, self._newest):
            os.close(self._fault)
        self._fault = None

    def _dump_crash(self, now_ns: int) -> tuple[str, ...]:
        """Write the ring of a crashed control process, and remove it."""
        left = crashed(self._ring)
        number = _file_number(left)
        if number is None:
            return ()
        self._forget_fault()  # it is in this ring
        is_first, notes = self._retry_ns is None, list[str]()
        try:
            self._dump(left, "crash", notes, make_room=is_first)
        except OSError:
            self._retry_ns = now_ns + RETRY_NS
            return tuple(notes) if is_first else ()
        self._retry_ns = None
        if _file_number(left) == number:  # otherwise another crash replaced it
            left.unlink(missing_ok=True)
        return tuple(notes)

    def _dump(self, ring: Path, kind: str, notes: list[str], *, make_room: bool) -> None:
        """Write a ring, remove the oldest dumps, and add sentences about both.

        Raises
        ------
        OSError
            If the disk refuses the dump.
        """
        now = dt.datetime.now(dt.UTC)
        target = self._directory / f"{kind}-{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z.rec"
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            self._write(ring, target, notes, make_room=make_room)
        except (OSError, RecordError) as error:
            notes.append(f"{target}: the flight recorder is not written: {error}")
            if isinstance(error, OSError):
                raise
            return
        notes.append(f"flight recorder written to {target}")
        try:
            for old in self._oldest_first()[:-MOST_DUMPS]:
                old.unlink(missing_ok=True)
        except OSError as error:
            notes.append(f"the oldest dumps of the flight recorder cannot be removed: {error}")

    def _write(self, ring: Path, target: Path, notes: list[str], *, make_room: bool) -> None:
        """Write a ring; on a full disk replace the oldest dumps, one after the other."""
        freed = 0
        while True:
            try:
                dump(ring, target)
            except OSError as error:
                dumps = self._oldest_first() if make_room and error.errno in _FULL else []
                if not dumps or freed >= dump_size(ring):
                    raise
            else:
                return
            freed += dumps[0].stat().st_size
            dumps[0].unlink()
            notes.append(f"the disk is full: {dumps[0]} is removed to make room for a newer one")

    def _oldest_first(self) -> list[Path]:
        """Return all dumps, oldest first."""
        return sorted(
            (path for each in _KINDS for path in self._directory.glob(f"{each}-*.rec")),
            key=lambda path: age_rank(path.stat()),
        )


def _file_number(path: Path) -> int | None:
    """Return a file's identity, to notice a replacement; None if there is no file."""
    try:
        return path.stat().st_ino
    except FileNotFoundError:
        return None
