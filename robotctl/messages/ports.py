"""Ports: what the runtime needs of the world, implemented by drivers and their simulated twins."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import BusStatus, EmergencyStopSource, Feedback


class Frame(NamedTuple):
    """A classic CAN data frame with an 11-bit identifier; `stamp_ns` is its reception time."""

    arbitration_id: int
    data: bytes
    stamp_ns: int


class CanPort(Protocol):
    """A CAN bus that never raises into the loop: failures are counted in `status`."""

    def send(self, arbitration_id: int, data: bytes) -> bool:
        """Queue one frame without waiting; False if the bus did not take it."""

    def receive(self) -> list[Frame]:
        """Return, without waiting, all frames received since the last call, oldest first."""

    def status(self) -> BusStatus:
        """Return the state of the controller and the counters since the start."""

    def close(self) -> None:
        """Release the bus."""


class RobotPort(Protocol):
    """Motor controllers and sensors, whatever wire they hang on."""

    def receive(self, now_ns: int) -> Feedback:
        """Return what arrived since the last call."""

    def send(self, command: ActuatorCommand, now_ns: int) -> None:
        """Send one actuator command and ask for the next feedback."""

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Stop and latch all motor controllers at once."""

    def clear_faults(self) -> None:
        """Ask the motor controllers to clear their latches, if the causes are gone."""

    def close(self) -> None:
        """Disable the motors, then release the wire."""


class Clock(Protocol):
    """The only source of time."""

    def now_ns(self) -> int:
        """Return monotonic time [ns]."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until `deadline_ns`; return at once where it has passed."""
