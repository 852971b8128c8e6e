"""Protocol of a monitor: it compares inputs of a powered robot and reports contradictions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import msgspec

from robotctl.messages.control import Feedback, ImuFeedback, WheelCommand
from robotctl.messages.faults import Fault
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount

if TYPE_CHECKING:
    from robotctl.safety.plausibility import PlausibilityConfig


@dataclass(frozen=True, slots=True)
class Monitored:
    """What monitors must know of the robot.

    Parameters
    ----------
    plausibility
        Tolerances.
    wheel_names
        The driven wheels.
    deadband
        Of the bridges.
    steering_max_rad
        Bound of the linkage [rad]; 0: no steering.
    a_max_rad_s2
        What a wheel gains where the robot drives off as fast as it may [rad/s^2], > 0.
    sonars
        The ring, in the order of the bus.
    imu
        Where the IMU sits, and how far the robot may be tilted.
    """

    plausibility: PlausibilityConfig
    wheel_names: tuple[str, ...]
    deadband: float
    steering_max_rad: float
    a_max_rad_s2: float
    sonars: tuple[SonarMount, ...]
    imu: ImuConfig


class Motion(Protocol):
    """What encoders and IMU say of the motion; computed when asked for."""

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """Speed of each driven wheel [rad/s]."""

    @property
    def jumps(self) -> int:
        """Impossible jumps of the counts so far."""

    @property
    def pose_odom_base(self) -> SE2:
        """Pose of odometry."""

    @property
    def imu(self) -> ImuFeedback | None:
        """What the IMU says; None on a robot without one."""


class MonitorInputs(msgspec.Struct, frozen=True, gc=False):
    """What monitors see in a tick.

    Parameters
    ----------
    feedback
        What the bus brought since the last tick.
    command
        What the bridges did when it was taken.
    supply_v
        Newest voltage of the drive's supply [V]; None before the first.
    motion
        By encoders and IMU.
    """

    feedback: Feedback
    command: WheelCommand
    supply_v: float | None
    motion: Motion


class Monitor(Protocol):
    """One member of `supervision.MONITORS`."""

    def reset(self) -> None:
        """Reset: the robot is armed."""

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick of a powered robot; return a contradiction."""
