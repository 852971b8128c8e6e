"""Writes the traffic of a bus as a candump log (`candump -L`), readable by python-can.

One line a frame, `(seconds.microseconds) channel id#data`, the time being that of the bus plus an
epoch; for CAN FD `id##FLAGSdata`, with 1 for bit-rate switch and 2 for an error-passive
transmitter.
The same run writes the same bytes. There are no comment lines: readers of the format do not know
them. Errors on the wire stand in it as SocketCAN error messages of class BUSERROR.
"""

from __future__ import annotations

import fcntl
import math
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from firmware_sim.bus.frame import (
    CLASSIC_MAX,
    ERROR_FLAG,
    EXTENDED_FLAG,
    EXTENDED_MASK,
    FD_FLAGS_SHIFT,
    REMOTE_FLAG,
    STANDARD_MASK,
    Frame,
)

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus


def log_line(frame: Frame, channel: str, epoch_ns: int = 0) -> str:
    """Return a frame as one line of a candump log, with its line end.

    Parameters
    ----------
    frame
        Frame or error message.
    channel
        Name of the bus, without spaces.
    epoch_ns
        Added to the time of the bus (ns).
    """
    arbitration_id, data, stamp_ns = frame
    micros = (stamp_ns + epoch_ns) // 1000
    text = data.hex().upper()
    if arbitration_id <= STANDARD_MASK:
        return (
            f"({micros // 1_000_000:010d}.{micros % 1_000_000:06d}) {channel} "
            f"{arbitration_id:03X}#{text}\n"
        )
    if arbitration_id & ERROR_FLAG:
        name = f"{arbitration_id:08X}"
    elif arbitration_id & EXTENDED_FLAG:
        name = f"{arbitration_id & EXTENDED_MASK:08X}"
    else:
        name = f"{arbitration_id & STANDARD_MASK:03X}"
    if arbitration_id & REMOTE_FLAG:
        text = f"R{len(data)}" if data else "R"
    elif arbitration_id > CLASSIC_MAX:
        text = f"#{arbitration_id >> FD_FLAGS_SHIFT:X}{text}"
    return f"({micros // 1_000_000:010d}.{micros % 1_000_000:06d}) {channel} {name}#{text}\n"


def next_log(path: Path) -> Path:
    """Return the path of the log after this one: `run-0008.log` after `run-0007.log`.

    A file without a number is the first of its kind. Numbers of existing files are skipped.
    """
    match = re.fullmatch(r"(.*)-(\d+)", path.stem)
    stem, digits = match.groups() if match else (path.stem, "0001")
    number = int(digits)
    while True:
        number += 1
        following = path.with_name(f"{stem}-{number:0{len(digits)}d}{path.suffix}")
        if not following.exists():
            return following


def _opened(path: Path) -> TextIO:
    """Open a log, locked while open so that other programs see that it is being written."""
    file = path.open("w", encoding="ascii")
    with suppress(OSError):  # some network disks know no locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def _check_channel(channel: str) -> None:
    """Raise ValueError where a name would break the lines of a log."""
    if not channel or channel.split() != [channel]:
        raise ValueError(f"channel {channel!r}: a log needs a name without spaces")


class LogWriter:
    """Writes every frame of a bus to a file, or to files in turn.

    Parameters
    ----------
    bus
        The bus; the writer taps it and is no node.
    file
        Path to write to, replaced where it exists and locked (flock) until it is closed, or an
        open text file (which `close` leaves open).
    channel
        Name of the bus in the log.
    epoch_ns
        Added to the time of the bus (ns); may be changed after its clock has paused.
    file_bytes
        Size of a file given by its path at which the next one begins [bytes].
    next_file
        Returns the path of the next file for that of the last.

    Raises
    ------
    ValueError
        If the channel's name has spaces.
    OSError
        If the file cannot be opened. A disk that fills up later ends the log, not the bus.
    """

    def __init__(
        self,
        bus: Bus,
        file: Path | TextIO,
        channel: str = "simcan0",
        *,
        epoch_ns: int = 0,
        file_bytes: float = math.inf,
        next_file: Callable[[Path], Path] = next_log,
    ) -> None:
        _check_channel(channel)
        self._owned = isinstance(file, Path)
        self._file = _opened(file) if isinstance(file, Path) else file
        self.epoch_ns = epoch_ns
        self._file_bytes = file_bytes if self._owned else math.inf
        self._next_file = next_file
        self._bytes = 0
        self.add(bus, channel)

    def add(self, bus: Bus, channel: str) -> None:
        """Write the frames of one more bus, under its name; raises ValueError if that has spaces.

        The order of the lines is that in which frames are complete.
        """
        _check_channel(channel)
        bus.tap(lambda frame: self._write(frame, channel))

    def _write(self, frame: Frame, channel: str) -> None:
        if not self._file.closed:
            line = log_line(frame, channel, self.epoch_ns)
            try:
                if self._bytes > self._file_bytes:
                    self._turn()
                self._file.write(line)
            except OSError as error:
                self._give_up(error)
            self._bytes += len(line)

    def _turn(self) -> None:
        """Continue in the next file."""
        self._file.close()
        self._file = _opened(self._next_file(Path(self._file.name)))
        self._bytes = 0

    def flush(self) -> None:
        """Flush what has been written so far."""
        if not self._file.closed:
            try:
                self._file.flush()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Stop writing, for example on a full disk: the bus continues."""
        sys.stderr.write(f"{self._file.name}: logging of frames stopped: {error.strerror}\n")
        with suppress(OSError):
            self._file.close()

    def close(self) -> None:
        """Finish the log; frames to come are not written."""
        self.flush()
        if self._owned:
            self._file.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
