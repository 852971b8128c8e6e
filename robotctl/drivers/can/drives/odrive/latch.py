"""Latch of an ODrive's faults, which keeps it from power until `clear_faults`."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.odrive import faults
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import Fault, FaultCode

STALE_NS: Final = 10_000_000
"""Time after clearing in which an error may have been on its way before [ns]."""


class Latch:
    """Holds the first fault, and all errors that the drive told since they were cleared.

    Parameters
    ----------
    part
        Name of the drive.

    Attributes
    ----------
    fault
        The fault; None: nothing is latched.
    state
        State of the drive that goes with it.
    """

    __slots__ = ("_cleared_ns", "_clearing", "_errors", "_part", "fault", "state")

    def __init__(self, part: str) -> None:
        self.fault: Fault | None = None
        self.state = DriveState.STOPPED
        self._part = part
        self._errors = (0, 0, 0, 0)
        """Errors of axis, motor, encoder and controller; with 0.6 only the first."""
        self._clearing = False
        """Whether the next heartbeat decides."""
        self._cleared_ns = NEVER_NS

    def hold(self, code: FaultCode, text: str, state: DriveState) -> None:
        """Latch a fault, if none is."""
        if self.fault is None:
            self.fault, self.state = Fault(code, text, self._part), state

    def stop(self, text: str) -> None:
        """Latch an emergency stop, whatever is latched."""
        self._clearing = False
        self.fault = None
        self.hold(FaultCode.DRIVE_EMERGENCY_STOP, text, DriveState.EMERGENCY_STOP)

    def is_stale(self, stamp_ns: int) -> bool:
        """Return whether a message received at a time [ns] may be older than the clearing."""
        return stamp_ns - self._cleared_ns <= STALE_NS

    def add(
        self, *, is_old: bool, axis: int = 0, motor: int = 0, encoder: int = 0, controller: int = 0
    ) -> None:
        """Latch errors of the drive: nearer to the cause than what the host found."""
        known = self._errors
        errors = (known[0] | axis, known[1] | motor, known[2] | encoder, known[3] | controller)
        if errors == known:
            return
        self._errors = errors
        if self.fault is not None and self.state is DriveState.EMERGENCY_STOP:
            return
        if is_old:
            fault = faults.old_fault(*errors, self._part)
        else:
            fault = faults.new_fault(errors[0], self._part)
        is_stop = fault.code is FaultCode.DRIVE_EMERGENCY_STOP
        self.fault = fault
        self.state = DriveState.EMERGENCY_STOP if is_stop else DriveState.FAULT

    @property
    def has_errors(self) -> bool:
        """Whether the drive told errors since they were cleared."""
        return self._errors != (0, 0, 0, 0)

    def clear(self, now_ns: int) -> None:
        """Note that the drive was told to clear its errors; the next heartbeat decides."""
        self._errors = (0, 0, 0, 0)
        self._clearing, self._cleared_ns = True, now_ns

    def keep(self) -> None:
        """Forget a clearing that is under way: the drive was lost or restarted."""
        self._clearing = False

    def judge(self, *, clean: bool) -> None:
        """Take whether a heartbeat is free of errors, after a clearing."""
        if self._clearing:
            self._clearing = False
            if clean and not self.has_errors:
                self.fault = None
