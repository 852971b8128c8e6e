"""Robots and inputs for monitors."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import Feedback, ImuFeedback
from robotctl.model.actuators import Actuator
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.monitor import Monitored, MonitorInputs
from robotctl.safety.plausibility_config import PlausibilityConfig
from tests.native_frames import WHEELS
from tests.safety.exact_tolerances import CONFIG, DEADBAND


def monitored(
    actuators: tuple[Actuator, ...] = WHEELS,
    *,
    config: PlausibilityConfig = CONFIG,
    joint_max_rad: tuple[float, ...] = (),
    a_max_rad_s2: float = float("inf"),
    sonars: tuple[SonarMount, ...] = (),
) -> Monitored:
    """A robot with exact tolerances."""
    return Monitored(config, actuators, DEADBAND, joint_max_rad, a_max_rad_s2, sonars, ImuConfig())


@dataclass
class MotionDouble:
    """Motion as a test says it is."""

    speeds_rad_s: tuple[float, ...] = ()
    angles_rad: tuple[float, ...] = ()
    jumps: int = 0
    pose_odom_base: SE2 | None = None
    imu: ImuFeedback | None = None


def inputs(
    actuators: tuple[ActuatorFeedback, ...],
    command: ActuatorCommand,
    speeds_rad_s: tuple[float, ...] = (0.0, 0.0),
    *,
    angles_rad: tuple[float, ...] = (),
    jumps: int = 0,
) -> MonitorInputs:
    """Inputs of one tick."""
    motion = MotionDouble(speeds_rad_s, angles_rad, jumps)
    return MonitorInputs(Feedback(actuators=actuators), command, motion)
