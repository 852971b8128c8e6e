"""Orderly ends: SIGTERM, SIGINT and SIGHUP set a flag that loops ask for."""

from __future__ import annotations

import signal
from types import FrameType


class StopFlag:
    """True once the process was asked to end."""

    def __init__(self) -> None:
        self._stopped = False
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        """Only remember; the loop ends between two ticks."""
        self._stopped = True

    def __call__(self) -> bool:
        """Return whether to end."""
        return self._stopped
