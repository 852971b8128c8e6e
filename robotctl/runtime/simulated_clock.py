"""The clock of a simulated run: its time pauses while this computer stalls.

The simulator owns it and writes it into a file in memory; `firmware_sim/pace.py` defines the format
and the rules of pausing.
"""

from __future__ import annotations

import enum
import mmap
import os
import time
from pathlib import Path
from typing import Final

from robotctl.errors import LinkError
from robotctl.runtime.clock import RealClock

_OFFSET, _LIMIT, _WRITTEN, _HELD, _LONGEST = range(5)
_SIZE: Final = 128
_GONE_NS: Final = 500_000_000
_POLL_NS: Final = 500_000


class Pacer(enum.IntEnum):
    """A process that simulated time waits for; the value is the index of its pid in the file."""

    CONTROL = 6
    NAVIGATION = 8


class SimulatedClock:
    """Reads the time of a simulated run, common to all its processes.

    Parameters
    ----------
    path
        File of the simulator.
    pacer
        This process, if simulated time waits for it.
    slack_ns
        Allowed lateness of a return from sleep before time pauses [ns].

    Raises
    ------
    LinkError
        If there is no such file.
    """

    def __init__(self, path: Path, pacer: Pacer | None = None, slack_ns: int = 0) -> None:
        try:
            with path.open("r+b") as file:
                self._map = mmap.mmap(file.fileno(), _SIZE)
        except (OSError, ValueError) as error:
            raise LinkError(f"{path}: no clock of a simulator: {error}") from error
        self._words = memoryview(self._map).cast("q")
        self._real = RealClock()
        self._pacer = pacer
        self._slack_ns = slack_ns
        self._last_ns = 0

    def now_ns(self) -> int:
        """Return simulated time: CLOCK_MONOTONIC less its pauses [ns]."""
        words = self._words
        limit_ns = words[_LIMIT]
        monotonic_ns = time.monotonic_ns()
        now_ns = monotonic_ns - words[_OFFSET]
        if now_ns > limit_ns:
            now_ns = limit_ns + max(0, monotonic_ns - words[_WRITTEN] - _GONE_NS)
        if now_ns < self._last_ns:
            return self._last_ns
        self._last_ns = now_ns
        return now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until `deadline_ns` of simulated time; return at once if it has passed."""
        words = self._words
        if self._pacer is not None:
            words[self._pacer + 1] = deadline_ns + self._slack_ns
            words[self._pacer] = os.getpid()
        while self.now_ns() < deadline_ns:
            wake_ns, monotonic_ns = deadline_ns + words[_OFFSET], self._real.now_ns()
            self._real.sleep_until(wake_ns if wake_ns > monotonic_ns else monotonic_ns + _POLL_NS)

    @property
    def longest_ns(self) -> int:
        """Longest pause since the last reset [ns]."""
        return int(self._words[_LONGEST])

    def forget_longest(self) -> None:
        """Reset the longest pause."""
        self._words[_LONGEST] = 0
