"""BARN's courses as worlds, and its metric."""

import gzip
import json
import math

import numpy as np
import pytest

from firmware_sim.world.world import load_world
from robotctl.maps.world import load_walls
from tools.barn import metric, read, result, summary, words_of, world_text

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


def test_only_who_arrives_in_time_and_touches_nothing_succeeds(given):
    challenge, course = given
    report = {"arrived": True, "time_s": 24.0, "min_clearance_m": 0.1, "collisions": 0}
    good = result(course, challenge, report)
    assert (good.arrived, good.metric) == (True, 0.25)
    for change in ({"arrived": False}, {"collisions": 1}, {"time_s": 100.5}):
        assert result(course, challenge, {**report, **change}).metric == 0.0
    stuck = {"arrived": False, "time_s": None, "min_clearance_m": None, "collisions": 0}
    none = result(course, challenge, stuck)
    assert summary([good, none]) == "0.1250 on average, 1 of 2"


def test_the_command_drives_without_a_map_from_start_to_goal(given, tmp_path):
    text = " ".join(words_of(tmp_path / "w.toml", given[0], "jackal"))
    assert "--start -2.25,3.0,90.0 --goal -2.25,13.0 --localiser none --lockstep" in text
