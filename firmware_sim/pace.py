"""Clocks for the simulation: the computer's, or one that waits for the computer.

A computer that stalls takes time from a simulation, and from the control loop and navigation that
it drives, which a robot's computer would not do. `SharedClock` pauses meanwhile, for the
simulation and for all processes that read it: simulated time stretches. It is a file in memory of
16 signed 64-bit integers in host byte order, `FIELDS`. The clock reads

    min(CLOCK_MONOTONIC - offset, limit)

and, `GONE_NS` after the last write, continues from the limit: a simulator that hangs must not halt
its observers, and no process may mistake the pause for one of its own. The limit is read before the
offset; a reader's time never goes back.
"""

from __future__ import annotations

import mmap
import time
from pathlib import Path
from typing import Final, Protocol

MARGIN_NS: Final = 5_000_000
"""Lag of the simulation, or of a pacer, at which time pauses [ns]."""

GONE_NS: Final = 500_000_000
"""Age of the last write after which time continues without the simulator [ns]."""

POLL_NS: Final = 500_000
"""Interval at which a stalled process checks the clock again [ns]."""

LONGEST_WAIT_NS: Final = 50_000_000

FIELDS: Final = (
    *("offset", "limit", "written", "held", "longest", "spare"),
    *("control's pid", "control's deadline", "navigation's pid", "navigation's deadline"),
    *("spare",) * 6,
)
"""Times in ns, and pids of the processes that pace the clock, 0: none. A deadline is the time of
this clock until which the process may be absent without being late. `held`: total pause; `longest`:
the longest pause."""

_OFFSET, _LIMIT, _WRITTEN, _HELD, _LONGEST = range(5)
PACERS: Final = ((6, 400_000_000), (8, 2_000_000_000))
"""Index of pid and deadline of control and of navigation, and the longest stall of each for which
time waits [ns]; a longer one counts as a hang. A step of navigation computes for longer."""


class Pace(Protocol):
    """Clock of `RealTime`."""

    longest_wait_ns: int

    def now_ns(self) -> int:
        """Return the time [ns]."""

    def wait_s(self, until_ns: int) -> float:
        """Return how long to wait for `until_ns` before looking again [s]."""

    def reached(self, time_ns: int) -> None:
        """Record that the simulation has reached `time_ns` of this clock [ns]."""


class MonotonicPace:
    """The computer's clock, which never waits."""

    longest_wait_ns = LONGEST_WAIT_NS

    def now_ns(self) -> int:
        """Return CLOCK_MONOTONIC [ns]."""
        return time.monotonic_ns()

    def wait_s(self, until_ns: int) -> float:
        """Return the time until `until_ns` [s]."""
        return max(0, until_ns - time.monotonic_ns()) / 1e9

    def reached(self, time_ns: int) -> None:
        """Do nothing."""


class SharedClock:
    """The clock of a simulated run, which waits for the simulation and for the control loop.

    Parameters
    ----------
    path
        File of the clock, replaced.

    Raises
    ------
    OSError
        If it cannot be created.
    """

    longest_wait_ns = MARGIN_NS // 2
    """Longest wait [ns]: the simulation, which moves the limit, must move before reaching it."""

    def __init__(self, path: Path) -> None:
        with path.open("w+b") as file:
            file.truncate(8 * len(FIELDS))
            self._map = mmap.mmap(file.fileno(), 8 * len(FIELDS))
        self._words = memoryview(self._map).cast("q")
        self._hold_ns = 0
        """Pause at the present limit so far [ns]."""
        self._given_up_ns = [0] * len(PACERS)
        """Deadline that each pacer has missed for too long [ns]."""
        self.reached(time.monotonic_ns())

    def now_ns(self) -> int:
        """Return the time [ns]; lag behind the limit is dropped."""
        words = self._words
        monotonic_ns = time.monotonic_ns()
        limit_ns = words[_LIMIT]
        now_ns = monotonic_ns - words[_OFFSET]
        if now_ns <= limit_ns:
            return now_ns
        # After a hang of this process its readers have continued from the limit.
        alone_ns = max(0, monotonic_ns - words[_WRITTEN] - GONE_NS)
        late_ns = now_ns - limit_ns - alone_ns
        words[_OFFSET] += late_ns
        self._hold_ns += late_ns
        words[_HELD] += late_ns
        words[_LONGEST] = max(words[_LONGEST], self._hold_ns)
        return limit_ns + alone_ns

    def wait_s(self, until_ns: int) -> float:
        """Return how long to wait for `until_ns` before looking again [s]."""
        words = self._words
        rest_ns = min(until_ns, words[_LIMIT]) + words[_OFFSET] - time.monotonic_ns()
        shortest_ns = POLL_NS if until_ns > words[_LIMIT] else 0
        return max(shortest_ns, rest_ns) / 1e9

    def reached(self, time_ns: int) -> None:
        """Let time run to a margin past the simulation and past the deadlines of its pacers."""
        words = self._words
        limit_ns = time_ns + MARGIN_NS
        for number, (pid, longest_ns) in enumerate(PACERS):
            paced_ns = words[pid + 1] + MARGIN_NS
            if words[pid] and paced_ns < limit_ns and self._waits_for(number, pid, longest_ns):
                limit_ns = paced_ns
        if limit_ns > words[_LIMIT]:
            self._hold_ns = 0
            words[_LIMIT] = limit_ns
        words[_WRITTEN] = time.monotonic_ns()

    def _waits_for(self, number: int, pid: int, longest_ns: int) -> bool:
        """Return whether to wait for a pacer that has not moved."""
        deadline_ns = self._words[pid + 1]
        if deadline_ns == self._given_up_ns[number]:
            return False
        if self._hold_ns and (self._hold_ns > longest_ns or not _runs(self._words[pid])):
            self._given_up_ns[number] = deadline_ns
            return False
        return True

    def close(self) -> None:
        """Release the file."""
        self._words.release()
        self._map.close()


class ClockReader:
    """A reader of a `SharedClock` in another process.

    Parameters
    ----------
    path
        File of the clock.
    """

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 8 * len(FIELDS), access=mmap.ACCESS_READ)
        self._words = memoryview(self._map).cast("q")
        self._last_ns = 0

    def now_ns(self) -> int:
        """Return the time [ns]."""
        words = self._words
        limit_ns = words[_LIMIT]
        monotonic_ns = time.monotonic_ns()
        now_ns = monotonic_ns - words[_OFFSET]
        if now_ns > limit_ns:
            now_ns = limit_ns + max(0, monotonic_ns - words[_WRITTEN] - GONE_NS)
        self._last_ns = max(self._last_ns, now_ns)
        return self._last_ns


def _runs(pid: int) -> bool:
    """Return whether a process exists and only waits for the CPU or a disk."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return False
    return stat.rpartition(b")")[2].split()[0] in (b"R", b"S", b"D")
