"""A witness of the machine's own pauses, for tests in real time.

A virtual machine is taken off its processors for tens of milliseconds now and then. A robot on it
stops, as it must, and the test that drove it fails for no fault of the robot. The witness is a
process that wakes every few milliseconds above every other task: where it wakes late, the machine
stood.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time

LIMIT_MS = 25
"""Half of the time for which a drive on simcan may be silent before the robot stops."""

ABOVE_ALL = 99
_PERIOD_NS = 5_000_000
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
        """Return the longest pause [ms] above `LIMIT_MS` that ended after `since_ns`, else 0."""
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


def _watch(processor: int) -> None:
    """Say when this thread woke late on a processor [ns], and by how much [ns], for ever."""
    os.sched_setaffinity(0, {processor})
    while True:
        due_ns = time.monotonic_ns() + _PERIOD_NS
        time.sleep(_PERIOD_NS / 1e9)
        late_ns = time.monotonic_ns() - due_ns
        if late_ns > LIMIT_MS * 1_000_000:
            os.write(1, b"%d %d\n" % (due_ns + late_ns, late_ns))


def _main() -> None:
    """Watch all processors until the standard input is closed."""
    processors = os.sched_getaffinity(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(ABOVE_ALL))  # its threads inherit it
    except PermissionError:
        os.write(1, _BESIDE)
    else:
        os.write(1, _ABOVE)
        for processor in processors:
            threading.Thread(target=_watch, args=(processor,), daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    _main()
