"""What our motor controller says, as the reports of the actuators on it."""

from __future__ import annotations

from robotctl.drivers.can.drives.native.drive import actuators_on
from robotctl.drivers.can.drives.native.feedback import NativeFeedback
from robotctl.drivers.can.drives.native.wire import DriveStatus, MotorStatus, WheelFeedback
from robotctl.messages.actuators import ActuatorFeedback
from robotctl.model.drives.drives import DifferentialDrive, TricycleDrive

DIFFERENTIAL = DifferentialDrive("differential", 0.3, 0.05, 2400)
TRICYCLE = TricycleDrive("tricycle", "front", 0.35, 0.06, 0.5, 3.0, 2400)
WHEELS = actuators_on(DIFFERENTIAL)
"""A left and a right wheel."""
WHEEL_AND_STEERING = actuators_on(TRICYCLE)


def reports(
    wheels: WheelFeedback | None,
    motor: MotorStatus | None,
    drive: DriveStatus | None,
    *,
    steers: bool = False,
) -> tuple[ActuatorFeedback, ...]:
    """Return the reports of two wheels, or of one and the steering, after these frames alone."""
    feedback = NativeFeedback("drive", 1 if steers else 2, steers=steers)
    feedback.update(wheels, motor, drive)
    return feedback.reports
