"""State of a moteus as the host drives it.

The drive latches its faults (mode 1) and its time-out (mode 11) itself; both are left by a stop.
The host sends none before `clear_faults`, so that what the drive says stays to be seen, and
latches what would otherwise go on by itself: a restart, a stop by somebody else.
"""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.host_state import HostState
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.faults import reported_fault
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import FaultCode

STILL_NS: Final = 100_000_000
"""Time without a step of the millisecond counter after which the drive hangs [ns]."""

LATE_MS: Final = 1000
"""Greatest lead of the counter over the host's clock [ms]; beyond it the drive has restarted."""

_STOPPED, _FAULT = DriveState.STOPPED, DriveState.FAULT


class MoteusState(HostState):
    """State machine of one moteus.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    timeout_ms
        Time-out of a command [ms].

    Attributes
    ----------
    mode
        Newest mode of the drive; -1: not known.
    """

    __slots__ = ("_counter", "_counter_ns", "mode")

    def __init__(self, name: str, timeout_ms: int) -> None:
        super().__init__(name, "moteus", timeout_ms)
        self.restart()

    def restart(self) -> None:
        """Follow a drive that has booted."""
        self.interlock.withhold()
        self.mode = -1
        self.confirmed = False
        self._counter = -1
        self._counter_ns = NEVER_NS

    def count(self, counter: int, now_ns: int) -> bool:
        """Take the drive's millisecond counter; return whether the drive has restarted."""
        before, before_ns = self._counter, self._counter_ns
        if counter == before:
            if now_ns - before_ns > STILL_NS:
                text = (
                    f"the millisecond counter of the moteus stands at {counter} for "
                    f"{(now_ns - before_ns) / 1e6:.0f} ms"
                )
                self.interlock.hold(_FAULT, FaultCode.DRIVE_UNREADABLE, text)
            return False
        self._counter, self._counter_ns = counter, now_ns
        if before < 0:
            return False
        passed_ms = (now_ns - before_ns) // 1_000_000
        return (counter - before) % (1 << 32) > 2 * passed_ms + LATE_MS

    def take(self, mode: int, fault: int) -> None:
        """Take mode and fault code of the drive."""
        self.mode = mode
        if mode == wire.FAULT:
            self.interlock.latch(_FAULT, reported_fault(fault, self._name))
        elif mode == wire.POSITION:
            self.confirmed = self.driving
        elif self.confirmed and mode == wire.TIMEOUT:
            text = "the moteus says that its time-out passed without a command (mode 11)"
            self.interlock.hold(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        elif self.confirmed:
            text = f"the moteus left position mode by itself: it is in mode {mode}"
            self.interlock.hold(_STOPPED, FaultCode.DRIVE_STOPPED, text)

    def clear(self) -> bool:
        """Leave the latch if the drive reports no fault any more; return whether that is so."""
        if self.mode == wire.FAULT:
            return False
        self.interlock.clear()
        return True
