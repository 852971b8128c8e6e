"""Clocks: the real one with absolute deadlines, and the virtual one that lockstep drives."""

from __future__ import annotations

import ctypes
import errno
import time
from collections.abc import Callable

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


def wall_offset_ns(now_ns: Callable[[], int] = time.monotonic_ns) -> int:
    """Return the lead of the wall clock over another, by default CLOCK_MONOTONIC [ns].

    The two are read one after the other; of three tries the one with the least time between counts.
    """
    tries = []
    for _ in range(3):
        before_ns = now_ns()
        wall_ns = time.time_ns()
        after_ns = now_ns()
        tries.append((after_ns - before_ns, wall_ns - (before_ns + after_ns) // 2))
    return min(tries)[1]


class RealClock:
    """CLOCK_MONOTONIC; sleeps to absolute deadlines (POSIX `clock_nanosleep`, TIMER_ABSTIME).

    `time.sleep` would add the time between reading the clock and going to sleep.
    """

    def __init__(self) -> None:
        self._nanosleep = ctypes.CDLL(None, use_errno=False).clock_nanosleep
        self._nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
        self._request = _Timespec()
        self._address = ctypes.addressof(self._request)

    now_ns = staticmethod(time.monotonic_ns)
    """Monotonic time [ns]."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until `deadline_ns`; a signal's handler runs and the sleep continues."""
        self._request.tv_sec, self._request.tv_nsec = divmod(deadline_ns, 1_000_000_000)
        # A signal ends the sleep early. The deadline is absolute, so sleeping again does not drift.
        while self._nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, self._address, None) == errno.EINTR:
            pass


class VirtualClock:
    """Virtual time: it moves only by `advance` and `sleep_until`."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return virtual time [ns]."""
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Move time to `deadline_ns`, never back."""
        self._now_ns = max(self._now_ns, deadline_ns)
