"""Records of links in the `.tlog` format of ground stations: each frame behind its time.

The time is eight bytes, big-endian, in microseconds since 1970.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

MOST_BYTES: Final = 64_000_000
"""Maximum size of a file, after which the next one begins [B]."""
MOST_FILES: Final = 32
"""Maximum files of one link; beyond it the oldest goes."""
_FLUSH_NS: Final = 1_000_000_000
_BUFFER: Final = 1 << 16
"""Maximum age of what is not written yet [ns], and size of a file's buffer [B]."""


def tlog_entry(wall_ns: int, frame: bytes | bytearray) -> bytes:
    """Return a frame behind its time, given in nanoseconds since 1970."""
    return (wall_ns // 1000).to_bytes(8, "big") + frame


class TlogRecorder:
    """Writes a file for each link, with a number that rises with each start.

    A disk that takes nothing ends the record, and disturbs nothing else.

    Parameters
    ----------
    folder
        Made where it is missing; None: nothing is recorded.
    wall_ns
        Returns the time since 1970 [ns].

    """

    def __init__(self, folder: Path | None, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._trouble = ""
        self._is_told = False
        self._folder = folder
        self._wall_ns = wall_ns
        self._files: dict[int, BinaryIO] = {}
        self._sizes: dict[int, int] = {}
        self._flushed_ns = 0

    def record(self, link: int, frame: bytes | bytearray) -> None:
        """Take down one frame that a link has sent or received."""
        if self._folder is None or self._trouble:
            return
        entry = tlog_entry(self._wall_ns(), frame)
        try:
            if self._sizes.get(link, MOST_BYTES) >= MOST_BYTES:
                self._begin(self._folder, link)
            self._files[link].write(entry)
            self._sizes[link] += len(entry)
        except OSError as error:
            self._stop(error)

    def flush(self, now_ns: int) -> None:
        """Hand over to the system what is a second old."""
        if now_ns - self._flushed_ns >= _FLUSH_NS:
            self._flushed_ns = now_ns
            try:
                for file in self._files.values():
                    file.flush()
            except OSError as error:
                self._stop(error)

    def take_trouble(self) -> str:
        """Return once why nothing is recorded any more; empty: it is, or that was said."""
        told, self._is_told = self._is_told, bool(self._trouble)
        return "" if told else self._trouble

    def close(self) -> None:
        """End the record."""
        for file in self._files.values():
            with suppress(OSError):
                file.close()
        self._files.clear()

    def _begin(self, folder: Path, link: int) -> None:
        """Begin the next file of a link; remove the oldest ones."""
        if link in self._files:
            self._files.pop(link).close()
        folder.mkdir(parents=True, exist_ok=True)
        numbered = {
            int(found[1]): path
            for path in folder.glob(f"link{link}-*.tlog")
            if (found := re.fullmatch(rf"link{link}-(\d+)", path.stem))
        }
        for number in sorted(numbered)[: max(len(numbered) - MOST_FILES + 1, 0)]:
            numbered[number].unlink(missing_ok=True)
        path = folder / f"link{link}-{max(numbered, default=0) + 1:04d}.tlog"
        self._files[link] = path.open("xb", buffering=_BUFFER)
        self._sizes[link] = 0

    def _stop(self, error: OSError) -> None:
        self._trouble = f"{self._folder}: nothing is recorded any more: {error.strerror}"
        self.close()
