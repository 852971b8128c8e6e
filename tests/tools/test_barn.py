"""BARN's courses as worlds, and its metric."""

import gzip
import json
import math

import numpy as np
import pytest

from firmware_sim.world.world import load_world
from robotctl.app.processes.navigator import load_mission
from robotctl.maps.world import load_walls
from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from robotctl.workbench.campaign.results import ResultFolder, head_of, result_of
from tools.barn import case, metric, read, score, world_text
from tools.case_file import write_cases

DATA = {
    "radius_m": 0.075,
    "start": [-2.25, 3.0, 1.5708],
    "goal_m": [-2.25, 13.0],
    "time_limit_s": 100.0,
    "worlds": [{"world": 6, "path_m": 12.0, "cylinders_m": [[-1.0, 5.0], [-3.5, 6.25]]}],
}


@pytest.fixture
def given(tmp_path):
    path = tmp_path / "worlds.json.gz"
    path.write_bytes(gzip.compress(json.dumps(DATA).encode()))
    challenge, (course,) = read(path)
    return challenge, course


def test_a_course_is_a_world_of_its_cylinders_for_simulator_and_robot(given, tmp_path):
    challenge, course = given
    path = tmp_path / f"{course.name}.toml"
    path.write_text(world_text(course, challenge))
    world = load_world(path)
    assert world.start == pytest.approx((-2.25, 3.0, math.pi / 2), abs=1e-4)
    low_x, low_y, high_x, high_y = world.bounds
    assert low_x < -3.5
    assert high_x > -1.0
    assert low_y < 3.0
    assert high_y > 13.0
    for thing, centre in zip(world.things, course.cylinders_m, strict=True):
        sides = thing.sides().reshape(-1, 2, 2)
        middles_m = np.hypot(*(sides.mean(axis=1) - centre).T)
        assert middles_m == pytest.approx(0.075)
        assert thing.height_m > 0.3
        assert world.solid_at(*centre)
    assert len(load_walls(path).segments) == len(world.segments)


@pytest.mark.parametrize(
    ("time_s", "score"), [(6.0, 0.5), (12.0, 0.5), (24.0, 0.25), (48.0, 0.125), (90.0, 0.125)]
)
def test_a_run_scores_half_a_point_at_most_and_an_eighth_at_least(time_s, score):
    assert metric(success=True, time_s=time_s, path_m=12.0) == pytest.approx(score)
    assert metric(success=False, time_s=time_s, path_m=12.0) == 0.0


@pytest.fixture
def campaign(given, tmp_path):
    challenge, course = given
    file = tmp_path / "barn.toml"
    write_cases(file, [case(course, challenge, tmp_path)])
    return load_campaign(file, lambda _: "")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, "0.2500 on average, 1 of 1"),
        ({"arrived": False}, "0.0000 on average, 0 of 1"),
        ({"collisions": 1}, "0.0000 on average, 0 of 1"),
        ({"time_s": 100.5}, "0.0000 on average, 0 of 1"),
        ({"arrived": False, "time_s": None}, "0.0000 on average, 0 of 1"),
    ],
)
def test_only_who_arrives_in_time_and_touches_nothing_succeeds(
    given, campaign, tmp_path, change, said
):
    report = {"mission": "barn_006", "arrived": True, "time_s": 24.0, "collisions": 0, "faults": []}
    (run,) = plan(campaign)
    with ResultFolder(tmp_path / "results", head_of("barn", 1, campaign, ("f", "s"))) as folder:
        folder.add(result_of(run, json.dumps({**report, **change}).encode(), ""))
    assert score(tmp_path / "results", [given[1]]) == f"BARN: {said}"


def test_the_command_drives_without_a_map_from_start_to_goal(campaign, tmp_path):
    (run,) = plan(campaign)
    assert "--robot jackal" in run.command
    assert f"--mission {tmp_path}/barn_006_mission.toml --localiser none" in run.command
    mission = load_mission(tmp_path / "barn_006_mission.toml")
    assert (mission.start.x_m, mission.start.y_m, mission.start.heading_deg) == (-2.25, 3.0, 90.0)
    assert (mission.item[0].x_m, mission.item[0].y_m) == (-2.25, 13.0)
