"""Ports of the runtime, implemented by drivers and their simulated twins."""

from __future__ import annotations

from typing import Final, NamedTuple, Protocol

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import BusStatus, EmergencyStopSource, Feedback

EXTENDED_FLAG: Final = 0x8000_0000
"""Flag of an identifier of 29 bits, as in SocketCAN's can_id."""
REMOTE_FLAG: Final = 0x4000_0000
"""Flag of a remote request, as in SocketCAN's can_id."""
FD_FLAG: Final = 1 << 32
"""Flag of a frame of CAN FD, so that its identifier equals that of no classic frame."""
FD_LENGTHS: Final = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data lengths of CAN FD [byte]."""


class Frame(NamedTuple):
    """A received CAN frame.

    Parameters
    ----------
    arbitration_id
        Identifier of 11 bits, or of 29 with `EXTENDED_FLAG`; with `REMOTE_FLAG` or `FD_FLAG` for
        such frames. One number, so that frames of different kinds never collide in a table.
    data
        0 to 8 bytes, in CAN FD one of `FD_LENGTHS`; for a remote request as many zeros as requested
        bytes.
    stamp_ns
        Time of reception [ns].
    """

    arbitration_id: int
    data: bytes
    stamp_ns: int


class CanPort(Protocol):
    """A CAN bus that never raises into the loop: failures are counted in `status`."""

    def send(self, arbitration_id: int, data: bytes) -> bool:
        """Queue one frame without waiting; False if the bus did not take it.

        Flags and lengths are those of `Frame`. A frame of CAN FD has the bus's data bit rate. A bus
        without CAN FD refuses it, and any bus refuses other lengths: the protocol pads.
        """

    def receive(self) -> list[Frame]:
        """Return, without waiting, all frames received since the last call, oldest first."""

    def status(self) -> BusStatus:
        """Return the state of the controller and the counters since the start."""

    def close(self) -> None:
        """Release the bus."""


class RobotPort(Protocol):
    """Motor controllers and sensors, on any bus."""

    def receive(self, now_ns: int) -> Feedback:
        """Return the feedback since the last call."""

    def send(self, command: ActuatorCommand, now_ns: int) -> None:
        """Send one actuator command and request the next feedback."""

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Stop and latch all motor controllers at once."""

    def clear_faults(self) -> None:
        """Ask the motor controllers to clear their latches, if the causes are gone."""

    def close(self) -> None:
        """Disable the motors, then release the buses."""


class Clock(Protocol):
    """The only source of time."""

    def now_ns(self) -> int:
        """Return monotonic time [ns]."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until `deadline_ns`; return at once if it has passed."""
