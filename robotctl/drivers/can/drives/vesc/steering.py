"""Steering by the servo output of a VESC, which tells no angle."""

from __future__ import annotations

from typing import Final, NamedTuple

from robotctl.drivers.can.bus_part import Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.vesc import wire

_STEP_NS: Final = 20_000_000
"""Longest time for which the servo is taken to have moved on between two commands [ns]."""


class Servo(NamedTuple):
    """Servo output: position at angle 0 [0, 1], turn over the range [rad], speed [rad/s]."""

    centre: float
    range_rad: float
    rate_rad_s: float


class Steering:
    """Moves the servo, and takes the joint to follow with the servo's rate.

    Parameters
    ----------
    axis
        The joint.
    servo
        Output and servo.
    number, reply_to
        Number of the VESC, and that to which it answers.

    Attributes
    ----------
    angle_rad
        Angle that the joint is taken to have [rad].
    """

    __slots__ = (
        "_angle_ns",
        "_centre",
        "_data",
        "_per_rad",
        "_rate_rad_s",
        "_reply_to",
        "_sent",
        "_servo_id",
        "angle_rad",
    )

    def __init__(self, axis: Axis, servo: Servo, number: int, reply_to: int) -> None:
        self.angle_rad = 0.0
        self._angle_ns = 0
        self._centre = servo.centre
        self._per_rad = axis.to_motor(1.0) / servo.range_rad
        self._rate_rad_s = abs(axis.to_wheel(servo.rate_rad_s))
        self._servo_id = wire.identifier(wire.PROCESS_SHORT_BUFFER, number)
        self._reply_to = reply_to
        self._sent = -1
        """Position last sent to the servo [0.001], and the data of that."""
        self._data = b""

    def steer(self, send: Send, angle_rad: float, now_ns: int) -> bool:
        """Move the servo; False if it cannot reach the angle."""
        position = self._centre + angle_rad * self._per_rad
        if not -0.0005 < position < 1.0005:
            return False
        thousandths = round(1000.0 * position)
        if thousandths != self._sent:
            self._sent = thousandths
            self._data = wire.pack_servo(self._reply_to, thousandths)
        send(self._servo_id, self._data)
        off_rad = angle_rad - self.angle_rad
        if off_rad:
            step_rad = self._rate_rad_s * min(now_ns - self._angle_ns, _STEP_NS) * 1e-9
            self.angle_rad += min(max(off_rad, -step_rad), step_rad)
        self._angle_ns = now_ns
        return True
