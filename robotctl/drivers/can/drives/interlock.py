"""Latches that the host keeps for a drive, so that no motion resumes unasked."""

from __future__ import annotations

from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import Fault


class Interlock:
    """Decides whether a drive may give power.

    After a latch, and after a boot, a command that was disabled must come first.

    Attributes
    ----------
    state, fault
        State latched (None: none is) and the fault that it came with.
    """

    __slots__ = ("_released", "fault", "state")

    def __init__(self) -> None:
        self.state: DriveState | None = None
        self.fault: Fault | None = None
        self._released = False

    def latch(self, state: DriveState, fault: Fault | None = None) -> None:
        """Stop the drive until `clear`; the first cause stays, but an emergency stop is told."""
        if self.state is None or state is DriveState.EMERGENCY_STOP:
            self.state, self.fault = state, fault
        self._released = False

    def clear(self) -> None:
        """Leave the latch."""
        self.state = self.fault = None

    def withhold(self) -> None:
        """Wait for a command that is disabled."""
        self._released = False

    def admits(self, enable: bool, in_service: bool) -> bool:
        """Return whether a command may give power to a drive that is in service or not."""
        if not enable:
            self._released = True
            return False
        if not in_service:
            self._released = False
        return self._released and self.state is None
