"""The planner of docs/extending.md finds the shortest way round walls, as `robotctl plan` does."""

import json
import subprocess
import sys

import numpy as np
import pytest

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import PlanFailure, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS

START, GOAL = SE2(1.0, 0.5), SE2(1.0, 2.5)


def plan(cells):
    space = PlanningMap(GridMap(cells, 0.05), Footprint())
    return PLANNERS["breadth_first"](PlannerConfig(margin_m=0.0)).plan(space, START, GOAL)


def test_it_goes_through_the_gap_by_the_shortest_way():
    cells = np.zeros((60, 60), np.int8)
    cells[30, :45] = 100
    found = plan(cells)
    assert found.length_m == pytest.approx(2.0 + 2 * (45 - 20) * 0.05)
    at_wall = found.poses[np.abs(found.poses[:, 1] - 1.525) < 0.02]
    assert at_wall[:, 0].min() > 45 * 0.05


def test_where_there_is_no_way_it_says_why():
    cells = np.zeros((60, 60), np.int8)
    cells[30, :] = 100
    failure = plan(cells)
    assert isinstance(failure, PlanFailure)
    assert failure.text


def test_the_command_uses_it(tmp_path):
    report = tmp_path / "report.json"
    options = ["plan", "--map", "flat", "--start", "1,1,0", "--goal", "6,3,90", "--planner"]
    done = subprocess.run(
        [sys.executable, "-m", "robotctl", *options, "breadth_first", "--report", str(report)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    assert found["found"]
    assert found["min_clearance_m"] > 0.0
    assert 5.3 < found["length_m"] < 8.0
