"""Protocol of a monitor: it compares inputs of a powered robot and reports contradictions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import msgspec

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import Feedback, ImuFeedback
from robotctl.messages.faults import Fault
from robotctl.model.actuators import Actuator
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount

if TYPE_CHECKING:
    from robotctl.safety.plausibility_config import PlausibilityConfig


@dataclass(frozen=True, slots=True)
class Monitored:
    """Parameters of the robot for the monitors.

    Parameters
    ----------
    plausibility
        Tolerances.
    actuators
        Wheels and joints.
    deadband
        Dead-band of the bridges [duty].
    joint_max_rad
        Bound of each joint [rad].
    a_max_rad_s2
        Acceleration of a wheel at the robot's limit [rad/s^2], > 0.
    sonars
        The ring, in the order of the bus.
    imu
        Where the IMU sits, and how far the robot may be tilted.
    """

    plausibility: PlausibilityConfig
    actuators: tuple[Actuator, ...]
    deadband: float
    joint_max_rad: tuple[float, ...]
    a_max_rad_s2: float
    sonars: tuple[SonarMount, ...]
    imu: ImuConfig


class Motion(Protocol):
    """Motion by encoders and IMU; computed on request."""

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """Speed of each driven wheel [rad/s]."""

    @property
    def angles_rad(self) -> tuple[float, ...]:
        """Angle of each driven wheel [rad], unwrapped."""

    @property
    def jumps(self) -> int:
        """Number of impossible jumps of the counts so far."""

    @property
    def pose_odom_base(self) -> SE2:
        """Pose of odometry."""

    @property
    def imu(self) -> ImuFeedback | None:
        """Latest IMU reading; None on a robot without an IMU."""


class MonitorInputs(msgspec.Struct, frozen=True, gc=False):
    """Inputs of the monitors in a tick.

    Parameters
    ----------
    feedback
        Feedback since the last tick.
    command
        Command of the drives when it was taken.
    motion
        By encoders and IMU.
    """

    feedback: Feedback
    command: ActuatorCommand
    motion: Motion


class Monitor(Protocol):
    """One member of `supervision.MONITORS`."""

    def reset(self) -> None:
        """Reset: the robot is armed."""

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick of a powered robot; return a contradiction."""
