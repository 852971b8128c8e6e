"""Docking to a wall by sonar: square to it, at the distance, without touching it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.dock import DockItem
from robotctl.planning.behave.behaviours.kind import Abilities
from robotctl.planning.behave.mission.check import check_mission
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.config import GuardConfig

BODY = GuardConfig().outline(())

AUTO, HOLD = ModeRequest(Mode.AUTO), ModeRequest(Mode.HOLD)
WALL_X_M = 4.95
DISTANCE_M = 0.2
ALL = frozenset({"front", "front_left", "front_right"})


def docking(make_run, robot, askew_deg, gap_m=1.2, **world):
    """Return a run before the wall between the rooms, `gap_m` from the front sonar."""
    mission = Mission("dock", StartPose(1.0, 1.0), (DockItem("dock", DISTANCE_M),))
    start = SE2(WALL_X_M - gap_m - robot.front, 1.0, math.radians(askew_deg))
    return make_run(robot, mission=mission, start=start, **world)


def end_of(run, robot):
    """Return distance from the wall [m], angle off square [deg] and touches once it has docked."""
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 60.0)
    assert out.state.mission_completed, run.messages[-3:]
    pose = run.world.pose
    gap_m = WALL_X_M - pose.x_m - robot.front
    return gap_m, math.degrees(pose.theta_rad), run.world.touched


DOCKED = (pytest.approx(DISTANCE_M, abs=0.03), pytest.approx(0.0, abs=4.0), 0)


@pytest.mark.parametrize("incidence_deg", [35.0, 65.0])
@pytest.mark.parametrize("askew_deg", [0.0, 12.0, -25.0])
def test_each_robot_stands_square_at_the_distance(make_run, robot, askew_deg, incidence_deg):
    run = docking(make_run, robot, askew_deg, most_incidence_deg=incidence_deg)
    run.step(AUTO)
    assert end_of(run, robot) == DOCKED


@pytest.mark.parametrize("seed", range(3))
def test_noise_outliers_and_an_interruption_change_nothing(make_run, robot, seed):
    askew_deg = float(np.random.default_rng(seed).uniform(-20.0, 20.0))
    noise = {"range_noise_m": 0.005, "outliers": 0.02, "most_incidence_deg": 35.0}
    run = docking(make_run, robot, askew_deg, seed=seed, **noise)
    run.step(AUTO)
    run.until(lambda _: run.world.distance_m > 0.4, 60.0)
    run.step(HOLD)
    for _ in range(10):
        run.step()
    run.step(AUTO)
    assert end_of(run, robot) == DOCKED


def test_a_robot_too_near_backs_up_to_the_distance(make_run, differential):
    run = docking(make_run, differential, 0.0, gap_m=0.14)
    run.step(AUTO)
    assert end_of(run, differential) == DOCKED


def test_without_a_wall_it_says_so(make_run, differential):
    mission = Mission("dock", StartPose(0.0, 0.0), (DockItem("dock", DISTANCE_M),))
    run = make_run(differential, mission=mission, flat=False)
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 10.0)
    assert "the front sonar sees no wall ahead" in out.state.message


def test_what_a_robot_cannot_do_is_refused(robot):
    mission = Mission("dock", StartPose(0.0, 0.0), (DockItem("dock", 0.12),))
    with pytest.raises(MissionError, match=r"distance_m = 0\.12 is never reached"):
        check_mission(mission, Abilities(robot.drive, ALL, GuardConfig(), BODY))
    near = Abilities(robot.drive, frozenset({"front"}), GuardConfig(margin_m=0.05), BODY)
    with pytest.raises(MissionError, match="no sonar that looks to the front left"):
        check_mission(mission, near)
    marked = replace(mission, item=(DockItem("dock", 0.3, marker=4),))
    with pytest.raises(MissionError, match="no camera that looks for markers"):
        check_mission(marked, Abilities(robot.drive, ALL, GuardConfig(), BODY))
