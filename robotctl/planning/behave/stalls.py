"""Stalls of navigation: the robot stands while one lasts, and resumes after a short one.

A computer that is busy for a moment is no reason to give up a mission, but one that is busy again
and again is none to drive with.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

SILENT: Final = "no messages from control"

GAP_NS: Final = 500_000_000
"""Longest gap between two steps that is no stall [ns]; after it the robot has come to rest."""

LONGEST_NS: Final = 5_000_000_000
"""A longer stall ends what the robot was doing [ns]: people may think that it has."""

HEALTHY_NS: Final = 1_000_000_000
"""Time in step and in touch with control after which the robot goes on [ns]."""

MOST: Final = 3
WITHIN_NS: Final = 60_000_000_000
"""Number of stalls, and time [ns], within which they end what the robot was doing."""

_LATE_NS: Final = 50_000_000
"""Delay from which on others or a signal kept a process from the processor [ns]."""

_EXPLAINS_NS: Final = 1_000_000_000
"""Time for which such a delay explains missing messages [ns]: they wait for the processor, too."""


class Stall(NamedTuple):
    """A stall that is not over: what it is, and whether the robot gives up for it."""

    words: str
    ends_mode: bool


class StallWatch:
    """Detector of stalls of navigation, from the times of its steps and the messages of control.

    Attributes
    ----------
    over
        What to tell people of a stall that was over in the last step; empty: none was.
    """

    def __init__(self) -> None:
        self.over = ""
        self._last_ns: int | None = None
        self._good_ns = 0
        """Last step in time and in touch with control [ns]; 0: before the first."""
        self._began_ns: int | None = None
        """When the present stall began; None: there is none [ns]."""
        self._healthy_ns: int | None = None
        """Since when it is over, if it stays so [ns]."""
        self._begins_ns: deque[int] = deque(maxlen=MOST)
        """When the last stalls began."""
        self._late_ns, self._late_at_ns = 0, -_EXPLAINS_NS
        """How long it was kept from a step last, and when that was [ns]."""
        self._words = ""

    def step(self, now_ns: int, late_ns: int, *, control_is_fresh: bool) -> Stall | None:
        """Return the stall that is not over at `now_ns`; None: all is well.

        Parameters
        ----------
        now_ns
            The time of this step [ns].
        late_ns
            How long the process was kept from it, by its own measure [ns].
        control_is_fresh
            Whether control's state is fresh.
        """
        self.over = ""
        gap_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        if late_ns > _LATE_NS:
            self._late_ns, self._late_at_ns = late_ns, now_ns
        if gap_ns <= GAP_NS and control_is_fresh:
            if self._began_ns is None:
                self._good_ns = now_ns
                return None
            return self._recover(now_ns)
        if not self._good_ns:
            return None
        self._healthy_ns = None
        if self._began_ns is None:
            self._began_ns = self._good_ns
            self._begins_ns.append(self._began_ns)
            self._words = self._cause(now_ns, gap_ns)
        elif gap_ns > GAP_NS:
            self._words = self._cause(now_ns, gap_ns)
        return self._verdict(now_ns - self._began_ns)

    def forget(self) -> None:
        """Forget the present stall: the robot gave up for it, or people took over."""
        self._began_ns = self._healthy_ns = None
        self._good_ns = self._last_ns or 0

    def _recover(self, now_ns: int) -> Stall | None:
        """Return the stall until navigation has been well for a while."""
        if self._healthy_ns is None:
            self._healthy_ns = now_ns
        began_ns = self._healthy_ns if self._began_ns is None else self._began_ns
        lasted_ns = self._healthy_ns - began_ns
        if now_ns - self._healthy_ns < HEALTHY_NS:
            return self._verdict(lasted_ns)
        self.forget()
        self.over = f"{self._words} for {lasted_ns / 1e9:.1f} s; the robot goes on"
        return None

    def _verdict(self, lasted_ns: int) -> Stall:
        """Return the present stall with what follows from it."""
        words = f"{self._words} for {lasted_ns / 1e9:.1f} s"
        often = len(self._begins_ns) == MOST and (
            self._begins_ns[-1] - self._begins_ns[0] < WITHIN_NS
        )
        if often:
            words += f", {MOST} times within a minute"
        return Stall(words, often or lasted_ns > LONGEST_NS)

    def _cause(self, now_ns: int, gap_ns: int) -> str:
        """Return what holds navigation up, by its own measure."""
        starved = now_ns - self._late_at_ns <= _EXPLAINS_NS
        if gap_ns > GAP_NS:
            why = "kept from the processor, or stopped" if starved else "a step took that long"
            return f"navigation was held up ({why})"
        if starved:
            late_ms = self._late_ns / 1e6
            return f"navigation was kept from the processor ({late_ms:.0f} ms late)"
        return SILENT
