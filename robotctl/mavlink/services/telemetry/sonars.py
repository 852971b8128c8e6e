"""DISTANCE_SENSOR: the range of each sonar."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.mavlink_port import Message


class Sonars(Microservice):
    """Sends the sonar ranges while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message with its configured rate."""
        rate_hz = self._context.config.rates.sonar_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_DISTANCE_SENSOR,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_EXTRA3,
            ),
        )

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None else distance_sensors(control, self._context.robot)


def distance_sensors(state: ControlState, robot: TelemetryRobot) -> list[Message]:
    """Return one DISTANCE_SENSOR for each sonar that works; its number is its place.

    Where there was no echo the distance is one step above the maximum, which ground stations
    show as out of range. A least distance is not known of any sonar: it is 0.
    """
    messages = []
    most_cm = min(frames.centimetres(robot.sonar.max_range_m), frames.UINT16_MAX - 1)
    beam_rad = math.radians(robot.sonar.beam_deg)
    sonars = zip(robot.sonars, state.sonar_m, state.sonar_stamp_ns, strict=False)
    for number, (mount, range_m, stamp_ns) in enumerate(sonars):
        if math.isnan(range_m):
            continue
        rotation = frames.sensor_rotation(mount.heading_rad)
        messages.append(
            common.MAVLink_distance_sensor_message(
                frames.boot_ms(stamp_ns),
                0,
                most_cm,
                most_cm + 1 if math.isinf(range_m) else frames.centimetres(range_m),
                common.MAV_DISTANCE_SENSOR_ULTRASOUND,
                number,
                rotation.orientation,
                255,  # covariance not known
                beam_rad,
                beam_rad,
                rotation.quaternion,
                0,  # quality not known
            )
        )
    return messages
