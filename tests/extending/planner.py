"""The planner of docs/extending.md: chosen in the robot's file, it goes round walls."""

from itertools import pairwise

import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.grid_map import GridMap
from robotctl.planning.global_planning.registry import make_planner


def test_it_goes_through_the_gap_and_keeps_off_the_walls():
    cells = np.zeros((60, 60), np.int8)
    cells[30, :45] = 100
    planner = make_planner("breadth_first", GridMap(cells, 0.05), 0.1)
    way = [(1.0, 0.5), *planner.way((1.0, 0.5), (1.0, 2.5))]
    assert way[-1] == (1.0, 2.5)
    points = np.concatenate([np.linspace(*ends, 100) for ends in pairwise(way)])
    crossing = points[np.abs(points[:, 1] - 1.525) < 0.02]
    assert len(crossing)
    assert crossing[:, 0].min() > 45 * 0.05 + 0.1


def test_where_there_is_no_way_it_says_so():
    cells = np.zeros((60, 60), np.int8)
    cells[30, :] = 100
    assert make_planner("breadth_first", GridMap(cells, 0.05), 0.1).way((1, 0.5), (1, 2.5)) == []


@pytest.mark.parametrize("name", ["breadth_first", "a_star"])
def test_the_robots_file_may_name_it(name):
    config = load_robot(find_file("diff_drive"), (f"navigation.planner={name}",))
    assert config.navigation.planner == name
