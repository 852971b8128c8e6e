"""Lines for people, from a process that must not wait for them."""

from __future__ import annotations

import os
import queue
import sys
import threading
from contextlib import suppress
from typing import Final

_MOST_LINES: Final = 1000
_LAST_WORDS_S: Final = 1.0
"""Maximum time for the waiting lines at the end."""


class Voice:
    """Prints lines from a thread of its own; use as a context manager.

    Who stopped reading (a pager, a stalled connection), or a disk that is full, holds up nobody and
    ends nothing. Beyond a thousand lines that wait, the newer ones are dropped.
    """

    def __init__(self) -> None:
        self._lines: queue.Queue[str | None] = queue.Queue(_MOST_LINES)
        self._thread = threading.Thread(target=self._print, daemon=True)

    def __enter__(self) -> Voice:
        """Begin to print."""
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Print what waits, unless it is not read."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
        self._thread.join(_LAST_WORDS_S)

    def say(self, line: str) -> None:
        """Print a line soon."""
        with suppress(queue.Full):
            self._lines.put_nowait(line)

    def _print(self) -> None:
        """Print until the end.

        Past `sys.stdout`, whose lock the interpreter would wait for at its end.
        """
        while (line := self._lines.get()) is not None:
            rest = f"{line}\n".encode(errors="surrogateescape")
            with suppress(OSError):
                while rest:
                    rest = rest[os.write(sys.stdout.fileno(), rest) :]
