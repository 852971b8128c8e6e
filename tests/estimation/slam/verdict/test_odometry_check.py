"""Odometry beside scans: what is wrong with either is measured."""

import itertools
import math

import numpy as np
import pytest

from robotctl.estimation.slam.verdict.odometry_check import OdometryCheck
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.lidar_world import along, drifting

WAY = along([(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0), (0.0, 0.0), (12.0, 0.0)])


def figures(change):
    """Return what is found where each motion by odometry is changed: f(number, (x, y, theta))."""
    check, odometry = OdometryCheck(), SE2()
    check.add(odometry, WAY[0])
    for number, (before, now) in enumerate(itertools.pairwise(WAY)):
        step = before.inverse() @ now
        odometry = odometry @ SE2(*change(number, np.array([step.x_m, step.y_m, step.theta_rad])))
        check.add(odometry, now)
    return check.figures()


def test_odometry_that_drifts_is_sound():
    check = OdometryCheck()
    for odometry, pose in zip(drifting(WAY, np.random.default_rng(1)), WAY, strict=True):
        check.add(odometry, pose)
    found = check.figures()
    assert found.contradicted_m == 0.0
    assert found.compared_m == pytest.approx(52.0, abs=2.0)
    assert found.distance_ratio == pytest.approx(1.0, abs=0.02)
    assert found.turn_ratio == pytest.approx(1.0, abs=0.1)
    assert found.yaw_rad == pytest.approx(0.0, abs=0.02)


def test_a_dead_encoder_contradicts_as_long_as_it_is_dead():
    found = figures(lambda number, step: step * (not 20 <= number < 36))  # 16 motions of 0.3 m
    assert found.longest_m == pytest.approx(16 * 0.3, abs=2.0)
    assert found.contradicted_m == found.longest_m


@pytest.mark.parametrize(
    ("factors", "distance", "turn"),
    [((1.1, 1.1, 1.0), 1.1, 1.0), ((1.0, 1.0, 0.7), 1.0, 0.7), ((1.0, -1.0, -1.0), 1.0, -1.0)],
)
def test_ratios_are_those_that_were_made(factors, distance, turn):
    found = figures(lambda _, step: step * factors)
    assert found.distance_ratio == pytest.approx(distance)
    assert found.turn_ratio == pytest.approx(turn)


@pytest.mark.parametrize("yaw_deg", [90.0, -45.0, 180.0])
def test_a_lidar_turned_on_its_mounting_is_measured(yaw_deg):
    mount = SE2(0.0, 0.0, math.radians(yaw_deg))

    def turned(_, step):
        moved = mount.inverse() @ SE2(*step) @ mount
        return moved.x_m, moved.y_m, moved.theta_rad

    off = figures(turned).yaw_rad - math.radians(yaw_deg)
    assert math.remainder(off, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_a_jump_of_the_map_is_no_motion():
    check = OdometryCheck()
    for number, pose in enumerate(WAY):
        if number == 30:
            check.restart(pose, SE2(5.0, 3.0, 1.0) @ pose)
        check.add(pose, pose if number < 30 else SE2(5.0, 3.0, 1.0) @ pose)
    assert check.figures().contradicted_m == 0.0


def test_a_robot_that_hardly_moved_tells_no_ratio():
    check = OdometryCheck()
    for pose in WAY[:12]:
        check.add(pose, pose)
    found = check.figures()
    assert math.isnan(found.distance_ratio)
    assert math.isnan(found.turn_ratio)
