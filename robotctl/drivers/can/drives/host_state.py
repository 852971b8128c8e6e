"""State of a drive that obeys whoever commands it: what latches is the host's."""

from __future__ import annotations

from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.messages.actuators import NEVER_NS, DriveState
from robotctl.messages.faults import FaultCode


class HostState:
    """Follows the commands to a drive and what it says to them; a kind of drive adds its answers.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    make
        Make of the drive, for people.
    timeout_ms
        Time-out of a command [ms].

    Attributes
    ----------
    state
        State to report.
    interlock
        Latches.
    driving
        Whether the last command gave power.
    confirmed
        Whether the drive has said that it takes these commands.
    """

    __slots__ = (
        "_commanded_ns",
        "_make",
        "_name",
        "_since_ns",
        "_timeout_ns",
        "confirmed",
        "driving",
        "interlock",
        "state",
    )

    def __init__(self, name: str, make: str, timeout_ms: int) -> None:
        self._name = name
        self._make = make
        self._timeout_ns = timeout_ms * 1_000_000
        self._commanded_ns = NEVER_NS
        self._since_ns = NEVER_NS
        """When commands began to give power [ns]."""
        self.interlock = Interlock(name)
        self.state = DriveState.BOOT
        self.driving = self.confirmed = False

    def admit(self, enable: bool, in_service: bool, now_ns: int) -> bool:
        """Return whether the command of this tick may give power, and note that it is sent."""
        was_driving = self.driving
        if was_driving and now_ns - self._commanded_ns > self._timeout_ns:
            silence = f"no command for {(now_ns - self._commanded_ns) / 1e6:.0f} ms"
            text = f"{silence}: the time-out of the {self._make} has passed"
            self.interlock.hold(DriveState.STOPPED, FaultCode.DRIVE_COMMAND_TIMEOUT, text)
        self.driving = driving = self.interlock.admits(enable, in_service)
        if not driving:
            self.confirmed = False
        elif not was_driving:
            self._since_ns = now_ns
        self._commanded_ns = now_ns
        return driving

    def refuse(self) -> None:
        """Note that the command of this tick gives no power after all."""
        self.driving = self.confirmed = False

    def unreadable(self, words: str) -> None:
        """Stop a drive that sends what is not documented."""
        self.interlock.hold(DriveState.FAULT, FaultCode.DRIVE_UNREADABLE, words)

    def update(self, in_service: bool) -> bool:
        """Follow the drive's service and latches; return whether `state` has changed."""
        before = self.state
        if self.interlock.state is not None:
            self.state = self.interlock.state
        elif not in_service:
            self.state = DriveState.BOOT
        else:
            self.state = DriveState.ENABLED if self.confirmed else DriveState.READY
        return self.state is not before
