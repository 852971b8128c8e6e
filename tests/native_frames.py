"""Our motor controller in tests: its actuators, what it says as reports of them, its robots."""

from __future__ import annotations

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.drives.fitting import Fitted, actuators_of, fit
from robotctl.drivers.can.drives.native.config import native_motor
from robotctl.drivers.can.drives.native.feedback import NativeFeedback
from robotctl.drivers.can.nodes import registry
from robotctl.drivers.can.nodes.motor import DriveStatus, MotorStatus, WheelFeedback
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.drivers.can.robot_parts import RobotParts
from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.ports import CanPort
from robotctl.model.drives.drives import DifferentialDrive, Drive, TricycleDrive
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

DIFFERENTIAL = DifferentialDrive("differential", 0.3, 0.05, 2400)
TRICYCLE = TricycleDrive("tricycle", "front", 0.35, 0.06, 0.5, 3.0, 2400)
MAX_RAD_S = 20.0
"""Greatest speed of a wheel [rad/s], of which our controller has no use."""


def fitted(drive: Drive) -> tuple[Fitted, ...]:
    """Return our controller on a robot."""
    return fit(drive, [native_motor(drive)])


WHEELS = actuators_of(fitted(DIFFERENTIAL))
"""A left and a right wheel."""
WHEEL_AND_STEERING = actuators_of(fitted(TRICYCLE))


def native_feedback(*, steers: bool = False) -> NativeFeedback:
    """Return the feedback of two wheels, or of one and the steering."""
    (each,) = fitted(TRICYCLE if steers else DIFFERENTIAL)
    return NativeFeedback(each.motor.name, each.axes)


def reports(
    wheels: WheelFeedback | None,
    motor: MotorStatus | None,
    drive: DriveStatus | None,
    *,
    steers: bool = False,
) -> tuple[ActuatorFeedback, ...]:
    """Return the reports of two wheels, or of one and the steering, after these frames alone."""
    feedback = native_feedback(steers=steers)
    feedback.update(wheels, motor, drive)
    return feedback.reports


def age_limits(
    parameters: NodeParameters, safety: SafetyConfig, period_ns: int
) -> tuple[AgeLimit, ...]:
    """Return how old what our controller and the sensor nodes tell may be."""
    drive = native_motor(DIFFERENTIAL).ages(safety, period_ns)
    return (*drive, *registry.age_limits(parameters, safety, period_ns))


def native_parts(
    codec: RobotCodec, parameters: NodeParameters, drive: Drive = DIFFERENTIAL
) -> RobotParts:
    """Return the parts of a robot of ours on one bus."""
    return RobotParts(codec, parameters, fitted(drive), MAX_RAD_S)


def native_robot(port: CanPort, parts: RobotParts) -> CanRobot:
    """Return the robot of such parts."""
    return CanRobot({"": port}, parts)
