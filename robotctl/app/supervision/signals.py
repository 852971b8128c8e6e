"""Signals as flags that loops poll: orderly shutdown, and the emergency stop."""

from __future__ import annotations

import ctypes
import signal
from collections.abc import Callable
from types import FrameType
from typing import Final

_PR_SET_NAME: Final = 15
"""Option of prctl(2)."""


def name_process(part: str = "") -> None:
    """Call this process robotctl or robotctl-PART, so that `pkill robotctl` finds it.

    The kernel keeps 15 characters.
    """
    name = f"robotctl-{part}" if part else "robotctl"
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode(), 0, 0, 0)


def hold_emergency_signal() -> None:
    """Block SIGUSR1, so that it ends no process, until `on_emergency_signal`."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGUSR1,))


def on_emergency_signal(act: Callable[[], None]) -> None:
    """Call `act` for each SIGUSR1, first for a pending one."""
    signal.signal(signal.SIGUSR1, lambda _number, _frame: act())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGUSR1,))


class StopFlag:
    """Flag that is set once the process was asked to end."""

    def __init__(self) -> None:
        self._stopped = False
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        """Set the flag; the loop ends between two ticks."""
        self._stopped = True

    def __call__(self) -> bool:
        """Return whether to end."""
        return self._stopped


class CtrlC:
    """Ctrl-C as KeyboardInterrupt, also where Python drops that: while it frees an object."""

    def __init__(self) -> None:
        self._asked = False
        signal.signal(signal.SIGINT, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._asked = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was a Ctrl-C; for loops, in case it was dropped."""
        if self._asked:
            raise KeyboardInterrupt


class EmergencySignal:
    """SIGUSR1: an emergency stop that needs no socket, no supervisor and no network.

    Signals that came before the process could take them (see `start_child`) count as well.
    """

    def __init__(self) -> None:
        self._asked = False
        on_emergency_signal(self._remember)

    def _remember(self) -> None:
        """Set the flag; the next tick stops."""
        self._asked = True

    def take(self) -> bool:
        """Return whether the signal was received since the last call."""
        asked, self._asked = self._asked, False
        return asked
