"""Stalls of this process, which bring about missing inputs by themselves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.faults import Fault, FaultCode

_SILENCE: Final = frozenset({FaultCode.NODE_SILENT, FaultCode.DRIVE_STOPPED})
"""Faults that a stall of this process causes, besides those of age."""

_PAUSE_NS: Final = 250_000_000
"""Time after a stall during which it explains them: the motor controller reports one status
later."""


class StallWatch:
    """Notes when this process was held up.

    A stalled process sends neither commands nor SYNC, so it causes the missing inputs itself.

    Parameters
    ----------
    limit_ns
        A step that comes later than this after the last was held up [ns].
    codes
        Faults of age, which a stall explains.
    """

    def __init__(self, limit_ns: int, codes: Iterable[FaultCode]) -> None:
        self._limit_ns = limit_ns
        self._silence = _SILENCE | set(codes)
        self._stepped_ns: int | None = None
        self._paused_ns = 0
        self._pause_over_ns = NEVER_NS

    def step(self, now_ns: int) -> None:
        """Note the time of this step, and whether this process was held up since the last one."""
        before_ns, self._stepped_ns = self._stepped_ns, now_ns
        if before_ns is not None and now_ns - before_ns > self._limit_ns:
            self._paused_ns, self._pause_over_ns = now_ns - before_ns, now_ns

    def explained(self, fault: Fault, now_ns: int) -> Fault:
        """Return a fault, or that this process was held up where this explains it."""
        if now_ns - self._pause_over_ns > _PAUSE_NS or fault.code not in self._silence:
            return fault
        text = f"control was held up for {self._paused_ns / 1e6:.0f} ms: {fault}"
        return Fault(FaultCode.CONTROL_HELD_UP, text)
