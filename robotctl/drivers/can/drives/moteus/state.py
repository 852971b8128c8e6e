"""State of a moteus as the host drives it.

The drive latches its faults (mode 1) and its time-out (mode 11) itself; both are left by a stop.
The host sends none before `clear_faults`, so that what the drive says stays to be seen, and
latches what would otherwise go on by itself: a restart, a stop by somebody else.
"""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.faults import reported_fault
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import Fault, FaultCode

STILL_NS: Final = 100_000_000
"""A millisecond counter that stands for longer is that of a drive that hangs [ns]."""

LATE_MS: Final = 1000
"""Greatest lead of the counter over the host's clock [ms]; beyond it the drive has restarted."""

_BOOT, _READY, _ENABLED = DriveState.BOOT, DriveState.READY, DriveState.ENABLED
_STOPPED, _FAULT = DriveState.STOPPED, DriveState.FAULT


class MoteusState:
    """State machine of one moteus.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    timeout_ms
        Time-out of a command [ms].

    Attributes
    ----------
    state
        State to report.
    interlock
        Latches.
    mode
        Newest mode of the drive; -1: not known.
    driving
        Whether the last command gave power.
    """

    __slots__ = (
        "_commanded_ns",
        "_confirmed",
        "_counter",
        "_counter_ns",
        "_name",
        "_timeout_ns",
        "driving",
        "interlock",
        "mode",
        "state",
    )

    def __init__(self, name: str, timeout_ms: int) -> None:
        self._name = name
        self._timeout_ns = timeout_ms * 1_000_000
        self.interlock = Interlock()
        self.state = _BOOT
        self.driving = False
        self._confirmed = False
        """Whether the drive has been in position mode since the host commands it."""
        self._commanded_ns = NEVER_NS
        self.restart()

    def restart(self) -> None:
        """Follow a drive that has booted."""
        self.interlock.withhold()
        self.mode = -1
        self._confirmed = False
        self._counter = -1
        self._counter_ns = NEVER_NS

    def admit(self, enable: bool, in_service: bool, now_ns: int) -> bool:
        """Return whether the command of this tick may give power, and note that it is sent."""
        if self.driving and now_ns - self._commanded_ns > self._timeout_ns:
            silence_ms = (now_ns - self._commanded_ns) / 1e6
            text = f"no command for {silence_ms:.0f} ms: the time-out of the moteus has passed"
            self._latch(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        self.driving = self.interlock.admits(enable, in_service)
        self._confirmed = self._confirmed and self.driving
        self._commanded_ns = now_ns
        return self.driving

    def count(self, counter: int, now_ns: int) -> bool:
        """Take the drive's millisecond counter; return whether the drive has restarted."""
        before, before_ns = self._counter, self._counter_ns
        if counter == before:
            if now_ns - before_ns > STILL_NS:
                text = (
                    f"the millisecond counter of the moteus stands at {counter} for "
                    f"{(now_ns - before_ns) / 1e6:.0f} ms"
                )
                self._latch(_FAULT, FaultCode.DRIVE_UNREADABLE, text)
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
            self._confirmed = self.driving
        elif self._confirmed and mode == wire.TIMEOUT:
            text = "the moteus says that its time-out passed without a command (mode 11)"
            self._latch(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        elif self._confirmed:
            text = f"the moteus left position mode by itself: it is in mode {mode}"
            self._latch(_STOPPED, FaultCode.DRIVE_STOPPED, text)

    def refuse(self) -> None:
        """Note that the command of this tick gives no power after all."""
        self.driving = self._confirmed = False

    def unreadable(self, words: str) -> None:
        """Stop a drive that sends what is not documented."""
        self._latch(_FAULT, FaultCode.DRIVE_UNREADABLE, words)

    def clear(self) -> bool:
        """Leave the latch if the drive reports no fault any more; return whether that is so."""
        if self.mode == wire.FAULT:
            return False
        self.interlock.clear()
        return True

    def update(self, in_service: bool) -> bool:
        """Follow the drive's service and latches; return whether `state` has changed."""
        before = self.state
        if self.interlock.state is not None:
            self.state = self.interlock.state
        elif not in_service:
            self.state = _BOOT
        else:
            self.state = _ENABLED if self._confirmed else _READY
        return self.state is not before

    def _latch(self, state: DriveState, code: FaultCode, text: str) -> None:
        self.interlock.latch(state, Fault(code, text, self._name))
