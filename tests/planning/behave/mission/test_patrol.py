"""The patrol mission, driven by each drive model in a simulated flat."""

import math
from pathlib import Path as FilePath

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.planning.behave.mission.mission_file import parse_mission

FILE = FilePath(__file__).parents[4] / "configs" / "missions" / "patrol.toml"


@pytest.fixture(scope="module")
def patrol():
    return parse_mission(FILE.read_text(), FILE.name)


def drive_it(run, seconds=130.0):
    run.step(ModeRequest(Mode.AUTO))
    return run.until(lambda out: out.state.mission_completed or out.state.mission_failed, seconds)


def test_patrol_is_completed_without_touching_a_wall(robot, patrol, make_run):
    run = make_run(robot, mission=patrol)
    out = drive_it(run)
    assert out.state.mission_completed, out.state.message
    assert out.state.item == out.state.items == len(patrol.item)
    assert run.world.touched == 0
    assert 26.0 < run.world.distance_m < 30.0
    assert 60.0 < run.now_ns / 1e9 < 90.0
    assert max(pose.x_m for pose in run.trace) > 7.0  # it was in the second room
    end = run.world.pose
    assert math.hypot(end.x_m - patrol.start.x_m, end.y_m - patrol.start.y_m) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_patrol_survives_noisy_odometry_and_sonars(robot, patrol, make_run, seed):
    run = make_run(robot, mission=patrol, seed=seed, drift=0.005, range_noise_m=0.01, outliers=0.01)
    out = drive_it(run)
    assert out.state.mission_completed, out.state.message
    assert run.world.touched == 0
