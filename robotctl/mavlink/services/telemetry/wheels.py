"""WHEEL_DISTANCE and RAW_RPM: distance and speed of each wheel."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.mavlink_port import Message

MAX_WHEELS = 16
"""Number of distances in WHEEL_DISTANCE."""


class Wheels(Microservice):
    """Sends the wheel distances while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the distance with its configured rate, and the speed, which is sent on request."""
        rate_hz = self._context.config.rates.wheel_distance_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_WHEEL_DISTANCE,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_EXTRA3,
            ),
            Stream(common.MAVLINK_MSG_ID_RAW_RPM, self._speeds, 0.0),
        )

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None else wheel_distance(control)

    def _speeds(self, now_ns: int) -> list[Message]:
        """Return one RAW_RPM for each driven wheel, in the order of the drive's wheels."""
        control = self._context.fresh_control(now_ns)
        speeds = () if control is None else control.wheel_rad_s
        return [
            common.MAVLink_raw_rpm_message(number, rad_s * 60.0 / math.tau)
            for number, rad_s in enumerate(speeds)
            if frames.fit(rad_s * 60.0)
        ]


def wheel_distance(state: ControlState) -> list[Message]:
    """Return WHEEL_DISTANCE of the driven wheels, in the order of the drive's wheels."""
    distances = state.wheel_distance_m[:MAX_WHEELS]
    padding = [0.0] * (MAX_WHEELS - len(distances))
    return [
        common.MAVLink_wheel_distance_message(
            frames.boot_us(state.stamp_ns), len(distances), [*distances, *padding]
        )
    ]
