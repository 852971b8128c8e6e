"""State of a VESC as the host drives it.

The firmware knows no states: a drive obeys whoever commands it, a fault lets go after half a
second, a time-out with the next command. What latches is the host's; that the drive really takes
commands is known by its own answer, which says whether its time-out has passed.
"""

from __future__ import annotations

from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.drivers.can.drives.vesc.faults import reported_fault
from robotctl.drivers.can.drives.vesc.wire import Report
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import Fault, FaultCode

_BOOT, _READY, _ENABLED = DriveState.BOOT, DriveState.READY, DriveState.ENABLED
_STOPPED, _FAULT = DriveState.STOPPED, DriveState.FAULT


class VescState:
    """State machine of one VESC.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    timeout_ms
        Its time-out [ms].

    Attributes
    ----------
    state
        State to report.
    interlock
        Latches.
    driving
        Whether the last command gave power.
    """

    __slots__ = (
        "_asked_ns",
        "_commanded_ns",
        "_confirmed",
        "_drive_fault",
        "_name",
        "_since_ns",
        "_timeout_ns",
        "driving",
        "interlock",
        "state",
    )

    def __init__(self, name: str, timeout_ms: int) -> None:
        self._name = name
        self._timeout_ns = timeout_ms * 1_000_000
        self.interlock = Interlock()
        self.state = _BOOT
        self.driving = False
        self._drive_fault = 0
        self._confirmed = False
        """Whether the drive has said that it takes the commands since `_since_ns`."""
        self._since_ns = self._commanded_ns = self._asked_ns = NEVER_NS

    def restart(self) -> None:
        """Follow a drive that has booted."""
        self.interlock.withhold()
        self._drive_fault = 0

    def admit(self, enable: bool, in_service: bool, now_ns: int) -> bool:
        """Return whether the command of this tick may give power, and note that it is sent."""
        if self.driving and now_ns - self._commanded_ns > self._timeout_ns:
            silence_ms = (now_ns - self._commanded_ns) / 1e6
            text = f"no command for {silence_ms:.0f} ms: the time-out of the VESC has passed"
            self._latch(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        admitted = self.interlock.admits(enable, in_service)
        if admitted and not self.driving:
            self._since_ns = now_ns
            self._confirmed = False
        self.driving = admitted
        self._commanded_ns = now_ns
        return admitted

    def ask(self, now_ns: int) -> None:
        """Note that the drive is asked for faults and flags, after the command of this tick."""
        self._asked_ns = now_ns

    def take(self, report: Report) -> None:
        """Take the drive's answer."""
        self._drive_fault = report.fault
        if report.fault:
            self.interlock.latch(_FAULT, reported_fault(report.fault, self._name))
        elif report.kill_switch:
            self._latch(_STOPPED, FaultCode.DRIVE_STOPPED, "the kill switch of the VESC is active")
        elif report.timed_out:
            if self._confirmed and self.driving:
                text = "the VESC says that its time-out passed without a command"
                self._latch(_STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        elif self.driving and self._asked_ns >= self._since_ns:
            self._confirmed = True

    def refuse(self) -> None:
        """Note that the command of this tick gives no power after all."""
        self.driving = self._confirmed = False

    def unreadable(self, words: str) -> None:
        """Stop a drive that sends what is not documented."""
        self._latch(_FAULT, FaultCode.DRIVE_UNREADABLE, words)

    def clear(self) -> None:
        """Leave the latch if the drive reports no fault any more."""
        if not self._drive_fault:
            self.interlock.clear()

    def update(self, in_service: bool) -> bool:
        """Follow the drive's service and latches; return whether `state` has changed."""
        before = self.state
        if self.interlock.state is not None:
            self.state = self.interlock.state
        elif not in_service:
            self.state = _BOOT
        else:
            self.state = _ENABLED if self.driving and self._confirmed else _READY
        return self.state is not before

    def _latch(self, state: DriveState, code: FaultCode, text: str) -> None:
        self.interlock.latch(state, Fault(code, text, self._name))
