"""Progress of a run in lockstep: a line that updates itself, or one now and then."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console
from rich.status import Status

from robotctl.messages.control import ControlState, NavigationState

_PATIENCE_S: Final = 2.0
"""A shorter run is its own progress [s]."""
_RENEW_S: Final = 0.2
_LINE_S: Final = 5.0
"""Interval between two lines if there is no terminal [s]."""


class LockstepProgress:
    """Shows the progress of a run; use as a context manager.

    Parameters
    ----------
    console
        Where to.
    max_seconds
        Of the robot's time, at which the run ends at the latest [s].
    """

    def __init__(self, console: Console, max_seconds: float) -> None:
        self._console = console
        self._max_seconds = max_seconds
        self._began_s = self._told_s = 0.0
        self._status: Status | None = None

    def __enter__(self) -> LockstepProgress:
        """Take the time."""
        self._began_s = self._told_s = time.monotonic()
        return self

    def __exit__(self, *_error: object) -> None:
        """Take the line away."""
        if self._status is not None:
            self._status.stop()

    def say(self, line: str) -> None:
        """Print a line of its own."""
        self._console.print(line, soft_wrap=True)

    def tell(self, control: ControlState, navigation: NavigationState) -> None:
        """Show the progress, if it is time to."""
        now_s = time.monotonic()
        every_s = _RENEW_S if self._console.is_terminal else _LINE_S
        if now_s - self._began_s < _PATIENCE_S or now_s - self._told_s < every_s:
            return
        self._told_s = now_s
        simulated_s = control.stamp_ns / 1e9
        text = (
            f"{simulated_s:.0f} s of at most {self._max_seconds:g} s simulated, "
            f"item {navigation.item} of {navigation.items} {navigation.item_name}, "
            f"{simulated_s / (now_s - self._began_s):.1f} × real time"
        )
        if not self._console.is_terminal:
            self._console.print(text, soft_wrap=True)
        elif self._status is None:
            self._status = self._console.status(text)
            self._status.start()
        else:
            self._status.update(text)
