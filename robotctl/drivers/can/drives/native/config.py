"""The table `[[motor]]` of our own motor controller, which a robot has where it names no other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, MotorDrive
from robotctl.drivers.can.drives.native.drive import NODE_ID, SERVO, NativeDrive
from robotctl.drivers.can.drives.native.scan import native_probe
from robotctl.drivers.can.probe import Probe
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Takes
from robotctl.model.drives.drives import Drive
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

NAME: Final = "drive"


@dataclass(frozen=True, slots=True)
class NativeMotor:
    """Our own motor controller, node 1: two channels and a steering servo.

    Parameters
    ----------
    kind
        Always "native".
    name
        Name of the drive in messages and logs.
    axes
        Wheels on channels 1 and 2, a steering joint on 3. Its encoders count at the wheel, so
        there is no `ratio`.
    bus
        Name of its bus; empty: that of `[nodes] drive`, or the first.
    """

    kind: Literal["native"]
    name: str
    axes: tuple[AxisConfig, ...]
    bus: str = ""

    abilities: ClassVar[Abilities] = Abilities(
        takes=Takes.DUTY,
        stops_alone=True,
        brakes=True,
        protected=True,
        stamps_positions=True,
        tells_speed=False,
    )
    accept_coasting: ClassVar[bool] = False
    accept_timeout_ms: ClassVar[int] = 0
    node_ids: ClassVar[tuple[int, ...]] = (NODE_ID,)
    silence: ClassVar[str] = "brakes after safety.command_timeout_ms, and latches"

    def __post_init__(self) -> None:
        """Check the axes."""
        numbers = [axis.axis for axis in self.axes]
        if len(set(numbers)) < len(numbers) or not set(numbers) <= {1, 2, SERVO}:
            raise InvalidValue(
                "axes",
                "each must have one of channels 1 and 2 (wheels) and 3 (steering) to itself, "
                f"found {', '.join(map(str, numbers))}",
                numbers,
            )
        for axis in self.axes:
            if axis.ratio != 1.0:
                problem = f"must be 1, its encoders count at the wheel, found {axis.ratio:g}"
                raise InvalidValue("axes", f"ratio of {axis.actuator}: {problem}", axis.ratio)

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of its reports."""
        wheels_ns = safety.feedback_timeout_periods * period_ns
        status_ns = safety.status_timeout_ms * 1_000_000
        name = self.name
        return (
            AgeLimit("motion", FaultCode.WHEELS_STALE, "wheel feedback is", name, wheels_ns),
            AgeLimit("report", FaultCode.MOTOR_STALE, "motor status is", name, status_ns),
            AgeLimit("supply", FaultCode.DRIVE_STALE, "drive status is", name, status_ns),
        )

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> MotorDrive:
        """Return the drive."""
        return NativeDrive(self.name, axes, needs)

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:  # noqa: ARG002 - as of every drive
        """Return None: robot.dbc has its frames."""
        return None

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind."""
        return native_probe()


def native_motor(drive: Drive, bus: str = "") -> NativeMotor:
    """Return our controller on a bus, wired in the order of a robot's wheels."""
    wheels = (AxisConfig(name, channel) for channel, name in enumerate(drive.wheel_names, 1))
    joints = (AxisConfig(name, SERVO) for name in drive.joint_names)
    return NativeMotor("native", NAME, (*wheels, *joints), bus)
