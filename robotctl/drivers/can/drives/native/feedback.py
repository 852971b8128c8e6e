"""Reports of the actuators on our motor controller, put together from its frames."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.native.faults import reported_fault
from robotctl.drivers.can.nodes.motor import DriveStatus, MotorStatus, WheelFeedback
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback, DriveState
from robotctl.model.actuators import Takes

_NO_WHEELS: Final = WheelFeedback(NEVER_NS, -1, (0, 0))
_NO_MOTOR: Final = MotorStatus(NEVER_NS, DriveState.BOOT, 0, (0.0, 0.0), (0.0, 0.0))
_NO_DRIVE: Final = DriveStatus(NEVER_NS, 0.0, 0.0, 0)


class NativeFeedback:
    """Keeps the newest frame of each kind.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    axes
        Wheels on channels 1 and 2, and joints, which are on the steering servo.

    Attributes
    ----------
    reports
        The axes, in their order, as the newest frames tell of them.
    """

    def __init__(self, name: str, axes: tuple[Axis, ...]) -> None:
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),) * len(axes)
        self._name = name
        self._axes = [
            (axis.number - 1, round(axis.current_a(1.0)), axis.takes is Takes.ANGLE)
            for axis in axes
        ]
        """Channel from 0 and sign of each, and whether it is a joint."""
        self._newest = _NO_WHEELS, _NO_MOTOR, _NO_DRIVE
        self._fault = reported_fault(DriveState.BOOT, 0, name)

    def update(
        self, wheels: WheelFeedback | None, motor: MotorStatus | None, drive: DriveStatus | None
    ) -> None:
        """Take the frames of a tick; None where none came."""
        if wheels is None and motor is None and drive is None:
            return
        last_wheels, last_motor, last_drive = self._newest
        if motor is not None:
            self._fault = reported_fault(motor.state, motor.faults, self._name)
        self._newest = newest = wheels or last_wheels, motor or last_motor, drive or last_drive
        wheels, motor, drive = newest
        heard, told = motor.stamp_ns != NEVER_NS, drive.stamp_ns != NEVER_NS
        self.reports = tuple(
            [
                ActuatorFeedback(
                    motion_ns=drive.stamp_ns,
                    angle_rad=sign * drive.steering_rad,
                    report_ns=motor.stamp_ns,
                    state=motor.state,
                    fault=self._fault,
                    supply_ns=drive.stamp_ns,
                    voltage_v=drive.bus_voltage_v if told else None,
                    command_age_ms=drive.command_age_ms if told else None,
                )
                if is_joint
                else ActuatorFeedback(
                    wheels.stamp_ns,
                    wheels.timestamp_us,
                    # Counts of 16 bits, of a reversed motor too.
                    sign * wheels.counts[channel] & 0xFFFF,
                    None,
                    None,
                    motor.stamp_ns,
                    motor.state,
                    self._fault,
                    sign * motor.currents_a[channel] if heard else None,
                    motor.temperatures_c[channel] if heard else None,
                    drive.stamp_ns,
                    drive.bus_voltage_v if told else None,
                    drive.command_age_ms if told else None,
                )
                for channel, sign, is_joint in self._axes
            ]
        )
