"""PLANNERS: the robot's file names one, and each finds paths of the same length."""

import math
from itertools import pairwise
from types import SimpleNamespace

import pytest

from robotctl.app.processes import navigator
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError, InvalidValue
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.model.wall_map import WallMap
from robotctl.planning.config import NavigationConfig
from robotctl.planning.global_planning.registry import PLANNERS, make_planner
from tests.planning.conftest import FLAT

START, GOAL = (1.5, 1.0), (6.5, 3.5)


def length_m(planner):
    way = [START, *make_planner(planner, grid_of_walls(WallMap(FLAT)), 0.18).way(START, GOAL)]
    return sum(math.dist(*ends) for ends in pairwise(way))


def test_all_planners_find_ways_of_one_length():
    lengths_m = [length_m(planner) for planner in PLANNERS]
    assert lengths_m == pytest.approx([lengths_m[0]] * len(PLANNERS), rel=0.02)
    assert lengths_m[0] > math.dist(START, GOAL)


@pytest.mark.parametrize(("found", "said"), [("astar", 'did you mean "a_star"'), ("x", "dijkstra")])
def test_an_unknown_planner_is_refused_with_those_there_are(found, said):
    with pytest.raises(InvalidValue, match=said):
        NavigationConfig(planner=found)
    with pytest.raises(ConfigError, match=rf"navigation.planner: .*{said}"):
        load_robot(find_file("diff_drive"), (f"navigation.planner={found}",))


@pytest.mark.parametrize("name", PLANNERS)
def test_navigation_plans_by_the_planner_that_the_robots_file_names(monkeypatch, name):
    made, learnt = [], []
    monkeypatch.setattr(navigator, "make_planner", lambda *given: made.append(given) or name)
    config = load_robot(find_file("diff_drive"), (f"navigation.planner={name}",))
    known = SimpleNamespace(world_map="the map")
    navigator.learn_paths(SimpleNamespace(learn_paths=learnt.append), config, known)
    assert learnt == [name]
    assert made == [(name, "the map", config.navigation.guard.half_width_m)]
