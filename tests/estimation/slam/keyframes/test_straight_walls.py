"""Walls that go on: two pieces of one wall say how the robot turned between them."""

import numpy as np
import pytest

from robotctl.estimation.landmarks.line_fitting import BeamNoise
from robotctl.estimation.landmarks.scan_lines import ScanLinesConfig, find_lines
from robotctl.estimation.slam.keyframes.straight_walls import aligned
from robotctl.estimation.slam_config import StraightWallsConfig
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.lidar_world import scan_of

CORRIDOR = np.array([[[-20.0, 1.1], [20.0, 1.1]], [[-20.0, -1.1], [20.0, -1.1]]])
AT, THEN = SE2(1.0, 0.1, 0.1), SE2(4.0, -0.2, -0.1)
ACROSS = np.radians(np.concatenate([np.arange(-120.0, -60.0, 2.0), np.arange(60.0, 120.0, 2.0)]))

CONFIG = StraightWallsConfig()


def walls_from(pose, walls=CORRIDOR):
    scan = scan_of(walls, pose, np.random.default_rng(1), sigma_m=0.005, angles=ACROSS)
    return find_lines(scan, ScanLinesConfig(BeamNoise(0.01))).segments


def test_walls_in_line_tell_the_heading_and_the_place_across_but_not_along():
    true = AT.inverse() @ THEN
    wrong = SE2(true.x_m + 0.2, true.y_m + 0.05, true.theta_rad + 0.06)
    pose, information = aligned(walls_from(AT), walls_from(THEN), wrong, CONFIG)
    assert pose.theta_rad == pytest.approx(true.theta_rad, abs=0.01)
    off = THEN.inverse() @ AT @ pose  # in the frame of the second scan
    turn = THEN.theta_rad
    along = np.array([np.cos(-turn), np.sin(-turn)])
    assert np.array([-along[1], along[0]]) @ [off.x_m, off.y_m] == pytest.approx(0.0, abs=0.03)
    assert along @ information[:2, :2] @ along < 1e-3 * np.trace(information[:2, :2])


@pytest.mark.parametrize("aside_m", [0.3, -0.5])
def test_a_wall_that_stands_aside_is_another_one(aside_m):
    farther = CORRIDOR + np.array([0.0, aside_m])
    assert aligned(walls_from(AT), walls_from(THEN, farther), AT.inverse() @ THEN, CONFIG) is None


def test_where_no_wall_is_in_line_nothing_is_said():
    assert aligned((), walls_from(THEN), SE2(), CONFIG) is None


def test_walls_that_are_not_quite_parallel_do_not_move_the_robot_along_them():
    c, s = np.cos(0.03), np.sin(0.03)
    bent = np.stack([CORRIDOR[0] @ [[c, s], [-s, c]], CORRIDOR[1]])
    start = AT.inverse() @ THEN
    pose, information = aligned(walls_from(AT), walls_from(THEN, bent), start, CONFIG)
    assert np.hypot(pose.x_m - start.x_m, pose.y_m - start.y_m) < 0.2
    along = np.array([np.cos(-THEN.theta_rad), np.sin(-THEN.theta_rad)])
    assert along @ information[:2, :2] @ along < 0.01 * np.trace(information[:2, :2])
