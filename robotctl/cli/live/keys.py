"""Single keys from the terminal: the user's emergency stop."""

from __future__ import annotations

import os
import select
import sys
import termios
from contextlib import suppress
from typing import Final, TextIO

EMERGENCY_KEYS: Final = frozenset(" eE")
HINT: Final = "Space or e: EMERGENCY STOP"
AFTERWARDS: Final = "afterwards the robot stands until a ground station arms it"
_DISABLED: Final = b"\0"
"""A control character that is none: `_POSIX_VDISABLE` of Linux."""


class Keys:
    """Reads keys without Enter and without waiting; use as a context manager.

    Does nothing if standard input is no terminal, or the process runs in the background, where
    reading would halt it. Ctrl-C keeps its meaning; Ctrl-Z and Ctrl-S have none meanwhile: they
    would leave a robot that drives on without the one who looks on, deaf to all keys.

    Parameters
    ----------
    stream
        Where keys come from.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        stream = sys.stdin if stream is None else stream
        self._descriptor: int | None = None
        if stream is not None and not stream.closed and stream.isatty():
            self._descriptor = stream.fileno()
        self._before: list[int | list[bytes | int]] | None = None

    @property
    def usable(self) -> bool:
        """Whether there is a terminal."""
        return self._descriptor is not None

    def __enter__(self) -> Keys:
        """Let keys through at once and unseen."""
        if self._descriptor is not None and self._foreground():
            self._before = termios.tcgetattr(self._descriptor)
            after = termios.tcgetattr(self._descriptor)
            after[0] = int(after[0]) & ~termios.IXON
            after[3] = int(after[3]) & ~(termios.ICANON | termios.ECHO)
            after[6][termios.VSUSP] = _DISABLED
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, after)
        return self

    def __exit__(self, *_error: object) -> None:
        """Give the terminal back as it was, if it is still there."""
        if self._descriptor is not None and self._before is not None:
            with suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None

    def emergency(self) -> bool:
        """Return whether an emergency key was pressed since the last call."""
        return not EMERGENCY_KEYS.isdisjoint(self.pressed())

    def pressed(self) -> str:
        """Return the keys that were pressed since the last call."""
        if self._descriptor is None or not self._foreground():
            return ""
        if not select.select([self._descriptor], [], [], 0.0)[0]:
            return ""
        try:
            return os.read(self._descriptor, 1024).decode(errors="replace")
        except OSError:  # the terminal is gone
            self._descriptor = None
            return ""

    def _foreground(self) -> bool:
        """Return whether the terminal listens to this process."""
        try:
            return self._descriptor is not None and (os.tcgetpgrp(self._descriptor) == os.getpgrp())
        except OSError:
            return False
