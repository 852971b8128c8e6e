"""The odometry a moment ago."""

import math

import pytest

from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.model.geometry.se2 import SE2


def test_poses_between_two_are_interpolated_with_the_heading_on_the_circle():
    history = OdometryHistory()
    history.add(100, SE2(0.0, 0.0, math.pi - 0.1))
    history.add(200, SE2(1.0, 2.0, -math.pi + 0.1))
    pose = history.at(150)
    assert (pose.x_m, pose.y_m) == (0.5, 1.0)
    assert abs(pose.theta_rad) == pytest.approx(math.pi)
    assert history.at(100) == SE2(0.0, 0.0, math.pi - 0.1)


def test_what_is_newer_than_all_is_the_last_and_what_is_older_is_unknown():
    history = OdometryHistory()
    assert history.at(0) is None
    history.add(100, SE2(1.0, 0.0, 0.0))
    history.add(200, SE2(2.0, 0.0, 0.0))
    assert history.at(900) == SE2(2.0, 0.0, 0.0)
    assert history.at(99) is None


def test_a_pose_that_is_not_newer_is_left_out():
    history = OdometryHistory()
    history.add(100, SE2(1.0, 0.0, 0.0))
    history.add(100, SE2(9.0, 0.0, 0.0))
    history.add(50, SE2(8.0, 0.0, 0.0))
    assert history.at(100) == SE2(1.0, 0.0, 0.0)
    assert history.at(60) is None


def test_it_forgets_what_is_long_ago():
    history = OdometryHistory()
    for stamp in range(1000):
        history.add(stamp, SE2(float(stamp), 0.0, 0.0))
    assert history.at(850) is None
    assert history.at(950) == SE2(950.0, 0.0, 0.0)
