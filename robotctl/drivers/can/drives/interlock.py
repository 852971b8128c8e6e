"""Latches that the host keeps for a drive, so that no motion resumes unasked."""

from __future__ import annotations

from robotctl.messages.actuators import DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import Fault, FaultCode


class Interlock:
    """Decides whether a drive may give power.

    After a latch, and after a boot, a command that was disabled must come first.

    Parameters
    ----------
    part
        Name of the drive, for its faults.

    Attributes
    ----------
    state, fault
        State latched (None: none is) and the fault that it came with.
    """

    __slots__ = ("_part", "_released", "fault", "state")

    def __init__(self, part: str = "") -> None:
        self._part = part
        self.state: DriveState | None = None
        self.fault: Fault | None = None
        self._released = False

    def latch(
        self, state: DriveState, fault: Fault | None = None, *, explains: bool = False
    ) -> None:
        """Stop the drive until `clear`; the first cause stays, but an emergency stop is told.

        Parameters
        ----------
        state, fault
            State to latch, and its fault.
        explains
            Whether the fault is nearer to the cause than any but an emergency stop.
        """
        before, stop = self.state, DriveState.EMERGENCY_STOP
        if before is None or (before is not stop and (explains or state is stop)):
            self.state, self.fault = state, fault
        self._released = False

    def explain(self, fault: Fault) -> None:
        """Latch what the drive itself says, in place of what the host found."""
        is_stop = fault.code is FaultCode.DRIVE_EMERGENCY_STOP
        state = DriveState.EMERGENCY_STOP if is_stop else DriveState.FAULT
        self.latch(state, fault, explains=True)

    def hold(self, state: DriveState, code: FaultCode, text: str) -> None:
        """Stop the drive as `latch` does, with a fault of a kind, in words."""
        self.latch(state, Fault(code, text, self._part))

    def stop(self, source: EmergencyStopSource) -> None:
        """Latch an emergency stop."""
        text = f"emergency stop ({source.name.lower().replace('_', ' ')})"
        self.hold(DriveState.EMERGENCY_STOP, FaultCode.DRIVE_EMERGENCY_STOP, text)

    def clear(self) -> None:
        """Leave the latch."""
        self.state = self.fault = None

    def withhold(self) -> None:
        """Wait for a command that is disabled."""
        self._released = False

    def admits(self, enable: bool, in_service: bool) -> bool:
        """Return whether a command may give power to a drive that is in service or not."""
        # A command to rest counts before the drive is in service, too: it may come into service in
        # the very tick in which the robot is armed.
        if not enable:
            self._released = True
            return False
        if not in_service:
            self._released = False
        return self._released and self.state is None
