"""State of a VESC as the host drives it.

The firmware knows no states: a drive obeys whoever commands it, a fault lets go after half a
second, a time-out with the next command. What latches is the host's; that the drive really takes
commands is known by its own answer, which says whether its time-out has passed.
"""

from __future__ import annotations

from robotctl.drivers.can.drives.host_state import HostState
from robotctl.drivers.can.drives.vesc.faults import reported_fault
from robotctl.drivers.can.drives.vesc.wire import Report
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import FaultCode

_STOPPED, _FAULT = DriveState.STOPPED, DriveState.FAULT


class VescState(HostState):
    """State machine of one VESC.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    timeout_ms
        Its time-out [ms].
    """

    __slots__ = ("_asked_ns", "_drive_fault")

    def __init__(self, name: str, timeout_ms: int) -> None:
        super().__init__(name, "VESC", timeout_ms)
        self._drive_fault = 0
        self._asked_ns = NEVER_NS

    def restart(self) -> None:
        """Follow a drive that has booted."""
        self.interlock.withhold()
        self._drive_fault = 0

    def ask(self, now_ns: int) -> None:
        """Note that the drive is asked for faults and flags, after the command of this tick."""
        self._asked_ns = now_ns

    def take(self, report: Report) -> None:
        """Take the drive's answer."""
        self._drive_fault = report.fault
        interlock = self.interlock
        if report.fault:
            interlock.latch(_FAULT, reported_fault(report.fault, self._name))
        elif report.kill_switch:
            text = "the kill switch of the VESC is active"
            interlock.hold(_STOPPED, FaultCode.DRIVE_STOPPED, text)
        elif report.timed_out:
            if self.confirmed:
                text = "the VESC says that its time-out passed without a command"
                interlock.hold(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        elif self.driving and self._asked_ns >= self._since_ns:
            self.confirmed = True

    def clear(self) -> None:
        """Leave the latch if the drive reports no fault any more."""
        if not self._drive_fault:
            self.interlock.clear()
