"""Control states of a robot that turns on the spot, in a room known by depth against bearing."""

import math
from collections.abc import Iterator

import msgspec

from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import ControlState
from robotctl.model.geometry.angles import wrap_angle
from tests.mavlink.conftest import CONTROL

ROBOT = load_robot(find_file("diff_drive"))
PERIOD_NS = 20_000_000
TURN_RAD = 0.025


def kitchen(bearing: float) -> float:
    """Depth along a bearing [m]; inf where nothing is in reach."""
    if 1.0 < bearing % math.tau < 2.0:
        return math.inf
    return 1.0 + (bearing % math.tau) / 4.0


def hallway(bearing: float) -> float:
    """Depth along a bearing of another place [m]."""
    return 0.8 + 2.5 * abs(math.cos(bearing))


def turning(
    room, *, begin_ns=10**9, x_m=0.0, heading=0.0, drift=0.0, rounds=1.2, step_rad=TURN_RAD
) -> Iterator[ControlState]:
    """Yield states; the room's bearings are those of the odometry plus `drift`."""
    stamps = [0] * len(ROBOT.sonar)
    ranges = [math.nan] * len(ROBOT.sonar)
    for i in range(round(rounds * math.tau / step_rad)):
        now_ns, theta = begin_ns + i * PERIOD_NS, heading + i * step_rad
        for k in range(4 * (i % 2), 4 * (i % 2) + 4):
            mount = ROBOT.sonar[k]
            reach = math.hypot(mount.x_m, mount.y_m)
            seen = room(theta + drift + mount.heading_rad)
            stamps[k], ranges[k] = now_ns, max(seen - reach, 0.05)
        yield msgspec.structs.replace(
            CONTROL,
            stamp_ns=now_ns,
            x_m=x_m,
            y_m=0.0,
            theta_rad=wrap_angle(theta),
            sonar_m=tuple(ranges),
            sonar_stamp_ns=tuple(stamps),
        )
