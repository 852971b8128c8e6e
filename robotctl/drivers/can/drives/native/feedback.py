"""Reports of the actuators on our motor controller, put together from its frames."""

from __future__ import annotations

from typing import Any, Final

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
        self._wheels, self._motor, self._drive = _NO_WHEELS, _NO_MOTOR, _NO_DRIVE
        self._fault = reported_fault(DriveState.BOOT, 0, name)
        self._states = self._told()

    def update(
        self, wheels: WheelFeedback | None, motor: MotorStatus | None, drive: DriveStatus | None
    ) -> None:
        """Take the frames of a tick; None where none came."""
        if motor is not None or drive is not None:
            self._take_state(motor, drive)
        elif wheels is None:
            return
        if wheels is not None:
            self._wheels = wheels
        newest = self._wheels
        stamp_ns, latch_us, counts = newest.stamp_ns, newest.timestamp_us, newest.counts
        self.reports = tuple(
            [
                ActuatorFeedback(*state)
                if is_joint
                # Counts of 16 bits, of a reversed motor too.
                else ActuatorFeedback(
                    stamp_ns, latch_us, sign * counts[channel] & 0xFFFF, None, None, *state
                )
                for (channel, sign, is_joint), state in zip(self._axes, self._states, strict=True)
            ]
        )

    def _take_state(self, motor: MotorStatus | None, drive: DriveStatus | None) -> None:
        """Take the frames that do not come in every tick."""
        if motor is not None:
            self._motor = motor
            self._fault = reported_fault(motor.state, motor.faults, self._name)
        if drive is not None:
            self._drive = drive
        self._states = self._told()

    def _told(self) -> list[tuple[Any, ...]]:
        """Return the fields of each wheel's report behind those of its motion; all of a joint's."""
        motor, drive, fault = self._motor, self._drive, self._fault
        heard, told = motor.stamp_ns != NEVER_NS, drive.stamp_ns != NEVER_NS
        state = motor.stamp_ns, motor.state, fault
        supply = (
            drive.stamp_ns,
            drive.bus_voltage_v if told else None,
            drive.command_age_ms if told else None,
        )
        return [
            (drive.stamp_ns, -1, 0, None, sign * drive.steering_rad, *state, None, None, *supply)
            if is_joint
            else (
                *state,
                sign * motor.currents_a[channel] if heard else None,
                motor.temperatures_c[channel] if heard else None,
                *supply,
            )
            for channel, sign, is_joint in self._axes
        ]
