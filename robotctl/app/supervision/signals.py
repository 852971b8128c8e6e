"""Signals as flags that loops ask for: orderly ends, and the emergency stop."""

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


class EmergencySignal:
    """SIGUSR1: an emergency stop that needs no socket, no supervisor and no network.

    Signals that came before the process could take them (see `start_child`) count as well.
    """

    def __init__(self) -> None:
        self._asked = False
        signal.signal(signal.SIGUSR1, self._on_signal)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGUSR1,))

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        """Only remember; the next tick stops."""
        self._asked = True

    def take(self) -> bool:
        """Return whether the signal was received since the last call."""
        asked, self._asked = self._asked, False
        return asked
