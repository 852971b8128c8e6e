"""The time that a simulated run has: counted from arming, in the robot's time."""

from __future__ import annotations

from robotctl.messages.control import ControlState
from robotctl.safety.state_machine import POWERED


class TimeLimit:
    """Says when the time of a run is over.

    It begins when the robot is first armed, so that neither a slow start nor a loaded computer
    takes anything from it. A robot that is ready has as long to be armed.

    Parameters
    ----------
    limit_s
        Time that the run has [s].
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._begin_ns: int | None = None
        self._was_armed = False

    def step(self, control: ControlState | None, now_ns: int, *, is_ready: bool) -> str:
        """Return why the run ends now; empty if it goes on.

        Parameters
        ----------
        control
            Latest state of the robot; None before the first.
        now_ns
            Robot's time [ns].
        is_ready
            Whether all that the robot needs has started.
        """
        if not self._was_armed and control is not None and control.state in POWERED:
            self._was_armed, self._begin_ns = True, now_ns
        if self._begin_ns is None and is_ready:
            self._begin_ns = now_ns
        if self._begin_ns is None or now_ns - self._begin_ns <= self._limit_s * 1e9:
            return ""
        if self._was_armed:
            return f"the limit of {self._limit_s:g} s after arming is reached (--max-seconds)"
        return f"the robot was not armed within {self._limit_s:g} s (--max-seconds)"
