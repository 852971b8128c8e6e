"""Sweeps unwound, against a drawn room whose walls are known in closed form."""

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.unwinding import unwound, unwound_view
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

WIDTH_M, DEPTH_M = 3.0, 2.0
"""Half the size of a room round the origin."""
END_NS = 5_000_000_000
ANGLES = np.radians(np.arange(-180.0, 180.0) + 0.3)


def path(v_m_s, omega_rad_s):
    """Return the pose by time of a robot that drives an arc, by the closed form."""

    def at(stamp_ns):
        t = 1e-9 * (stamp_ns - END_NS)
        theta = omega_rad_s * t
        if omega_rad_s == 0.0:
            return SE2(v_m_s * t, 0.3, 0.0)
        radius = v_m_s / omega_rad_s
        return SE2(radius * math.sin(theta), 0.3 + radius * (1.0 - math.cos(theta)), theta)

    return at


def swept(at, sweep_s, x_m=0.0, y_m=0.0, angles=ANGLES, end_ns=END_NS, name=""):
    """Return what a lidar measures in the room, beam by beam."""
    part = np.linspace(0.0, 1.0, len(angles)) if sweep_s > 0 else np.linspace(1.0, 0.0, len(angles))
    ranges = []
    for angle, share in zip(angles, part, strict=True):
        pose = at(end_ns - round(1e9 * abs(sweep_s) * (1.0 - share)))
        sensor = pose @ SE2(x_m, y_m)
        c, s = math.cos(pose.theta_rad + angle), math.sin(pose.theta_rad + angle)
        to_x = (math.copysign(WIDTH_M, c) - sensor.x_m) / c
        to_y = (math.copysign(DEPTH_M, s) - sensor.y_m) / s
        ranges.append(min(to_x, to_y))
    return RangeScan(end_ns, angles, np.array(ranges), 12.0, x_m, y_m, name=name, sweep_s=sweep_s)


def off_walls(scan, pose):
    """Return how far the echoes lie off the walls, seen from a pose [m]."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    x, y = (scan.points_base() @ np.array([[c, s], [-s, c]]) + (pose.x_m, pose.y_m)).T
    return np.minimum(np.abs(np.abs(x) - WIDTH_M), np.abs(np.abs(y) - DEPTH_M))


@pytest.mark.parametrize("sweep_s", [0.05, 0.2, -0.1])
@pytest.mark.parametrize(("v", "omega"), [(1.0, 0.0), (0.0, 2.0), (0.8, -1.0)])
def test_echoes_lie_on_the_walls_as_seen_from_the_end(sweep_s, v, omega):
    at = path(v, omega)
    scan = swept(at, sweep_s, x_m=0.25, y_m=-0.1)
    straight = unwound(scan, at)
    assert off_walls(scan, at(END_NS)).max() > 0.02
    assert off_walls(straight, at(END_NS)).max() < 1e-3  # nine straight pieces instead of an arc
    assert straight.sweep_s == 0.0
    assert (straight.stamp_ns, straight.x_m, straight.y_m) == (END_NS, 0.25, -0.1)


def test_beams_without_an_echo_turn_with_the_rest():
    at = path(0.0, 1.0)
    scan = swept(at, 0.1)
    scan.ranges_m[::2] = np.inf
    scan.ranges_m[1::4] = np.nan
    straight = unwound(scan, at)
    assert np.array_equal(np.isinf(straight.ranges_m), np.isinf(scan.ranges_m))
    assert np.array_equal(np.isnan(straight.ranges_m), np.isnan(scan.ranges_m))
    turned = straight.angles_rad - scan.angles_rad
    assert turned == pytest.approx(np.linspace(-0.1, 0.0, len(ANGLES)), abs=1e-9)


def test_a_scan_of_one_instant_and_one_of_unknown_motion_stay_as_they_are():
    at = path(1.0, 1.0)
    instant = RangeScan(END_NS, ANGLES, np.full(len(ANGLES), 2.0), 12.0)
    assert unwound(instant, at) is instant
    unknown = unwound(swept(at, 0.1), lambda _: None)
    assert np.array_equal(unknown.ranges_m, swept(at, 0.1).ranges_m)


def test_a_view_of_two_lidars_of_their_own_times_is_of_one_time():
    at = path(0.8, 1.5)
    front = swept(at, 0.1, x_m=0.3, angles=ANGLES[90:270])
    rear = swept(at, -0.1, x_m=-0.3, angles=ANGLES[:180] - 0.5 * math.pi, name="rear",
                 end_ns=END_NS - 60_000_000)  # fmt: skip
    view = unwound_view(RangeScan(
        front.stamp_ns, front.angles_rad, front.ranges_m, 12.0, 0.3, sweep_s=0.1, others=(rear,)
    ), at)  # fmt: skip
    assert len(view.points_base()) == 360
    assert off_walls(view, at(END_NS)).max() < 2e-3
