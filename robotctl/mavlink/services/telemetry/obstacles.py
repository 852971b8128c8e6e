"""OBSTACLE_DISTANCE: what lidar or sonars see all around; on request."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import FRESH_NS, TelemetryRobot
from robotctl.mavlink.frames import UINT16_MAX, boot_us, centimetres
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LidarScan
from robotctl.messages.mavlink_port import Message

SECTORS: Final = 72
"""Number of distances in OBSTACLE_DISTANCE."""
_SECTOR_RAD: Final = math.tau / SECTORS
_STEP_RAD: Final = math.radians(1.0)
_LASER: Final[int] = common.MAV_DISTANCE_SENSOR_LASER
_SOUND: Final[int] = common.MAV_DISTANCE_SENSOR_ULTRASOUND


class Obstacles(Microservice):
    """Sends the nearest distance in each sector of 5 degrees, clockwise from ahead."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message, off until a station asks for it."""
        return (Stream(common.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, self._build, 0.0),)

    def _build(self, now_ns: int) -> list[Message]:
        """Return the ring of the lidars, or of the sonars if no lidar says anything."""
        context = self._context
        control = context.fresh_control(now_ns)
        scans = [each for each in context.scans.values() if now_ns - each.stamp_ns <= FRESH_NS]
        if scans:
            seen = chain.from_iterable(map(_lidar, scans))
            most_m = max(each.max_range_m for each in scans)
            return [_ring(seen, most_m, max(each.stamp_ns for each in scans), _LASER)]
        robot = context.robot
        if control is None or not robot.sonars:
            return []
        echoes = _sonars(control, robot)
        return [_ring(echoes, robot.sonar.max_range_m, control.stamp_ns, _SOUND)]


def _sonars(control: ControlState, robot: TelemetryRobot) -> Iterator[tuple[float, float]]:
    """Yield bearing [rad] and distance [m] from `base` of points all over each sonar's beam."""
    beam_rad = math.radians(robot.sonar.beam_deg)
    count = max(round(beam_rad / _STEP_RAD), 1)
    for mount, range_m in zip(robot.sonars, control.sonar_m, strict=False):
        for k in range(count + 1) if not math.isnan(range_m) else ():
            angle = mount.heading_rad + beam_rad * (k / count - 0.5)
            yield _from_base(mount.x_m, mount.y_m, angle, range_m)


def _lidar(scan: LidarScan) -> Iterator[tuple[float, float]]:
    """Yield bearing [rad] and distance [m] from `base`, inf where nothing came back."""
    ranges = np.frombuffer(scan.ranges, "<f4").tolist()
    for number, range_m in enumerate(ranges):
        if not math.isnan(range_m):
            angle = scan.first_rad + number * scan.step_rad
            yield _from_base(scan.x_m, scan.y_m, angle, range_m)


def _from_base(x_m: float, y_m: float, angle: float, range_m: float) -> tuple[float, float]:
    if math.isinf(range_m):
        return angle, math.inf
    x_m += range_m * math.cos(angle)
    y_m += range_m * math.sin(angle)
    return math.atan2(y_m, x_m), math.hypot(x_m, y_m)


def _ring(
    seen: Iterator[tuple[float, float]], most_m: float, stamp_ns: int, sensor: int
) -> Message:
    """Return the message: one step above the maximum says that nothing is there."""
    most_cm = min(centimetres(most_m), UINT16_MAX - 2)
    ring = [UINT16_MAX] * SECTORS  # nobody looks there
    for bearing, distance_m in seen:
        sector = round(-bearing / _SECTOR_RAD) % SECTORS
        found_cm = most_cm + 1
        if math.isfinite(distance_m):
            found_cm = min(centimetres(distance_m), most_cm + 1)
        ring[sector] = min(ring[sector], found_cm)
    return common.MAVLink_obstacle_distance_message(
        boot_us(stamp_ns),
        sensor,
        ring,
        360 // SECTORS,
        0,
        most_cm,
        0.0,
        0.0,
        common.MAV_FRAME_BODY_FRD,
    )
