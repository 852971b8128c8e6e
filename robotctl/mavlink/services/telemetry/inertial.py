"""SCALED_IMU and VIBRATION: gyro and accelerometer."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ImuFeedback
from robotctl.messages.mavlink_port import Message

_NO_FIELD = (0, 0, 0)
"""Reading of a magnetometer, which the robot lacks."""


SHAKING_S: Final = 0.5
"""Time over which shaking is averaged [s]."""


class Inertial(Microservice):
    """Sends the readings of the IMU, if there is one, while control publishes."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._shaking = Shaking()

    def streams(self) -> tuple[Stream, ...]:
        """Return the readings with their configured rate, and the shaking, which is off."""
        rate_hz = self._context.config.rates.imu_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_SCALED_IMU,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_RAW_SENSORS,
            ),
            Stream(
                common.MAVLINK_MSG_ID_VIBRATION,
                self._vibration,
                0.0,
                common.MAV_DATA_STREAM_EXTRA3,
            ),
        )

    def step(self, now_ns: int) -> None:  # noqa: ARG002
        """Take the force of the last state."""
        control = self._context.control
        if control is not None and control.imu is not None:
            self._shaking.take(control.imu)

    def _vibration(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        if control is None or control.imu is None:
            return []
        stamp_us = frames.boot_us(control.imu.stamp_ns)
        return [common.MAVLink_vibration_message(stamp_us, *self._shaking.rms_m_s2, 0, 0, 0)]

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None or control.imu is None else scaled_imu(control.imu)


class Shaking:
    """Root mean square of the force about its mean along each axis [m/s^2]."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._means = [0.0, 0.0, 0.0]
        self._squares = [0.0, 0.0, 0.0]

    def take(self, imu: ImuFeedback) -> None:
        """Take a reading, once."""
        before_ns, self._stamp_ns = self._stamp_ns, imu.stamp_ns
        if before_ns is None or not 0 < imu.stamp_ns - before_ns < SHAKING_S * 1e9:
            if before_ns != imu.stamp_ns:
                self._means, self._squares = list(imu.force_m_s2), [0.0, 0.0, 0.0]
            return
        share = 1.0 - math.exp(-(imu.stamp_ns - before_ns) * 1e-9 / SHAKING_S)
        for axis, force in enumerate(imu.force_m_s2):
            self._means[axis] += share * (force - self._means[axis])
            square = (force - self._means[axis]) ** 2
            self._squares[axis] += share * (square - self._squares[axis])

    @property
    def rms_m_s2(self) -> tuple[float, float, float]:
        """Shaking along x, y, z of `base` [m/s^2]."""
        x, y, z = (math.sqrt(square) for square in self._squares)
        return x, y, z


def scaled_imu(imu: ImuFeedback) -> list[Message]:
    """Return SCALED_IMU in body FRD; a level robot at rest reads -1000 mG along z."""
    force = frames.frd_from_flu(*imu.force_m_s2)
    rate = frames.frd_from_flu(*imu.rate_rad_s)
    return [
        common.MAVLink_scaled_imu_message(
            frames.boot_ms(imu.stamp_ns),
            *(frames.milligravities(each) for each in force),
            *(frames.milliradians(each) for each in rate),
            *_NO_FIELD,
        )
    ]
