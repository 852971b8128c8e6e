"""A witness of the machine's own pauses, for tests in real time.

A virtual machine is taken off its processors for tens of milliseconds now and then, at once or in
pieces. A robot on it stops, as it must, and the test that drove it fails for no fault of the robot.
The witness is a process that wakes every few milliseconds above every other task: where it wakes
late, the machine stood. A robot's processes wait for each other across all processors, so that the
time counts in which any of them stood.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable

LIMIT_MS = 25
"""Half of the time for which a drive on simcan may be silent before the robot stops."""

WINDOW_MS = 100
"""Pauses count together where all of them ended within this time."""

ABOVE_ALL = 99
_PERIOD_NS = 5_000_000
_LATE_NS = 1_000_000
_ABOVE, _BESIDE = b"above\n", b"beside\n"


class PauseWitness:
    """Notes when this machine stood.

    Attributes
    ----------
    is_above
        Whether the witness has the right to be above all other tasks; without it nothing is noted,
        since late may mean that the tests themselves had the processor.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            (sys.executable, __file__), stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        self.is_above = self._process.stdout.readline() == _ABOVE
        self._output = self._process.stdout.fileno()
        os.set_blocking(self._output, False)
        self._heard = b""

    @property
    def pid(self) -> int:
        """The process id of the witness."""
        return self._process.pid

    def longest_ms(self, since_ns: int) -> float:
        """Return how long the machine stood after `since_ns` [ms]: above `LIMIT_MS`, else 0."""
        with contextlib.suppress(BlockingIOError):
            while heard := os.read(self._output, 65536):
                self._heard += heard
        pauses = [tuple(map(int, line.split())) for line in self._heard.splitlines()]
        return max(
            (late_ns / 1e6 for ended_ns, late_ns in pauses if ended_ns > since_ns), default=0.0
        )

    def close(self) -> None:
        """End the witness."""
        self._process.communicate()


def covered_ns(intervals: Iterable[tuple[int, int]]) -> int:
    """Return how much time intervals (begin, end) cover, where they overlap once [ns]."""
    total_ns = covered_until_ns = 0
    for begin_ns, end_ns in sorted(intervals):
        total_ns += max(end_ns - max(begin_ns, covered_until_ns), 0)
        covered_until_ns = max(covered_until_ns, end_ns)
    return total_ns


class Pauses:
    """The pauses of the last `WINDOW_MS`, of all processors."""

    def __init__(self) -> None:
        self._pauses: deque[tuple[int, int]] = deque()
        self._lock = threading.Lock()

    def add(self, due_ns: int, woken_ns: int) -> int:
        """Take in a pause that has just ended; return for how long the machine stood [ns]."""
        with self._lock:
            self._pauses.append((due_ns, woken_ns))
            while self._pauses[0][1] < woken_ns - WINDOW_MS * 1_000_000:
                self._pauses.popleft()
            return covered_ns(self._pauses)


def _watch(processor: int, pauses: Pauses) -> None:
    """Say until when [ns] and for how long [ns] the machine stood, for ever."""
    os.sched_setaffinity(0, {processor})
    while True:
        due_ns = time.monotonic_ns() + _PERIOD_NS
        time.sleep(_PERIOD_NS / 1e9)
        woken_ns = time.monotonic_ns()
        if woken_ns - due_ns > _LATE_NS:
            stood_ns = pauses.add(due_ns, woken_ns)
            if stood_ns > LIMIT_MS * 1_000_000:
                os.write(1, b"%d %d\n" % (woken_ns, stood_ns))


def _main() -> None:
    """Watch all processors until the standard input is closed."""
    processors = os.sched_getaffinity(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(ABOVE_ALL))  # its threads inherit it
    except PermissionError:
        os.write(1, _BESIDE)
    else:
        os.write(1, _ABOVE)
        pauses = Pauses()
        for processor in processors:
            threading.Thread(target=_watch, args=(processor, pauses), daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    _main()
