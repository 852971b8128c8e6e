"""Docking to a marker whose views are as uncertain as those of a camera."""

import math

import numpy as np
import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.dock import DockItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose

AUTO, HOLD = ModeRequest(Mode.AUTO), ModeRequest(Mode.HOLD)
MARKER = SE2(4.95, 1.0, 0.0)
DISTANCE_M = 0.2
STARTS = [(-1.6, 0.2, 0.0), (-1.5, -0.25, 0.3), (-1.3, 0.0, -0.35)]


class Camera:
    """Sees the marker from 0.3 to 2.5 m, within 35 degrees of ahead, a little wrong."""

    def __init__(self, run, seed):
        self.run, self.rng = run, np.random.default_rng(seed)
        self.step = run.step
        run.step = self.look

    def look(self, *requests):
        pose = self.run.world.pose
        there = pose.inverse() @ MARKER
        away_m = math.hypot(there.x_m, there.y_m)
        self.run.markers = ()
        if 0.3 < away_m < 2.5 and abs(math.atan2(there.y_m, there.x_m)) < math.radians(35.0):
            off = self.rng.normal(0.0, (0.01 * away_m, 0.005 * away_m, math.radians(3.0) * away_m))
            seen = there @ SE2(*off)
            self.run.markers = ((4, self.run.world.odometry @ seen),)
        return self.step(*requests)


def docking(make_run, robot, start, seed=0):
    item = DockItem("dock", DISTANCE_M, marker=4)
    mission = Mission("dock", StartPose(1.0, 1.0), (item,))
    at = MARKER @ SE2(start[0] - robot.front, start[1], start[2])
    run = make_run(robot, mission=mission, start=at, seed=seed)
    Camera(run, seed)
    return run


@pytest.mark.parametrize("start", STARTS)
def test_each_robot_stands_before_the_marker(make_run, robot, start):
    run = docking(make_run, robot, start)
    run.step(AUTO)
    run.until(lambda _: run.world.distance_m > 0.5, 60.0)
    run.step(HOLD)
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 60.0)
    assert out.state.mission_completed, run.messages[-3:]
    here = MARKER.inverse() @ run.world.pose
    assert -here.x_m - max(robot.front, 0.2) == pytest.approx(DISTANCE_M, abs=0.04)
    assert abs(here.y_m) < 0.08
    assert abs(math.degrees(here.theta_rad)) < 9.0
    assert run.world.touched == 0


def test_a_marker_that_is_not_there_is_told(make_run, differential):
    run = docking(make_run, differential, (-1.5, 0.0, 2.0))
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 10.0)
    assert "the camera does not see marker 4" in out.state.message
