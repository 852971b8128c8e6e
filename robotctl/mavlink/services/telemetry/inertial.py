"""SCALED_IMU: gyro and accelerometer."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ImuFeedback
from robotctl.messages.mavlink_port import Message

_NO_FIELD = (0, 0, 0)
"""There is no magnetometer."""


class Inertial(Microservice):
    """Sends the readings of the IMU, if there is one, while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message with its configured rate."""
        rate_hz = self._context.config.rates.imu_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_SCALED_IMU,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_RAW_SENSORS,
            ),
        )

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None or control.imu is None else scaled_imu(control.imu)


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
