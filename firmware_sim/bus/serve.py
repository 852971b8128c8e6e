"""A loop that runs a bus in real time: for tools, tests, and owners without a loop of their own."""

from __future__ import annotations

import ctypes
import select
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus

_PR_SET_TIMERSLACK = 29
_LONGEST_WAIT_NS = 50_000_000


class Service(Protocol):
    """Something with a descriptor to wait for: `Hub`, `Bridge`."""

    def fileno(self) -> int:
        """Return the descriptor that is readable when `service` has something to do."""

    def service(self, now_ns: int) -> None:
        """Do all work that needs no waiting; `now_ns` is CLOCK_MONOTONIC."""


def sharpen_timers() -> None:
    """Ask the kernel to wake this thread on time, not up to 50 us later.

    Linux only; elsewhere, and where it is refused, nothing happens.
    """
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)


def serve(
    bus: Bus,
    services: Sequence[Service],
    *,
    origin_ns: int,
    stop: Callable[[], bool],
    advance: Callable[[int], None] | None = None,
    tick_ns: int | None = None,
) -> None:
    """Keep a bus at the pace of the clock until `stop` returns true.

    It waits with `select`, which takes microseconds; epoll and poll round up to milliseconds, so
    that frames would come late.

    Parameters
    ----------
    bus
        The bus.
    services
        Hubs and bridges to serve after each step.
    origin_ns
        CLOCK_MONOTONIC at time 0 of the bus (ns).
    stop
        Called at least every 50 ms.
    advance
        Called with the time of the bus (ns) instead of `bus.advance`, for owners that advance more
        than the bus.
    tick_ns
        Longest step (ns); None: from event to event.
    """
    step = bus.advance if advance is None else advance
    longest_ns = _LONGEST_WAIT_NS if tick_ns is None else min(tick_ns, _LONGEST_WAIT_NS)
    sharpen_timers()
    while not stop():
        now_ns = time.monotonic_ns() - origin_ns
        event_ns = bus.next_event_ns
        wait_ns = longest_ns if event_ns is None else min(longest_ns, event_ns - now_ns)
        select.select(services, (), (), max(0, wait_ns) / 1e9)
        now_ns = max(time.monotonic_ns() - origin_ns, bus.now_ns)
        step(now_ns)
        for service in services:
            service.service(now_ns + origin_ns)
