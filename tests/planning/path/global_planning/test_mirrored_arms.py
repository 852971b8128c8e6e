"""A robot with an arm to one side passes a door that its mirrored twin cannot."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
import shapely.affinity

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, PlannerConfig, Reason
from robotctl.planning.path.global_planning.planners import PLANNERS

SIDE_M = 0.025
CORRIDOR_M, DOOR_M = 0.7, 0.8
"""The corridor is 3.5 cm wider than the robot."""
ARM_RIGHT = (
    (0.185, -0.165), (0.185, 0.165), (-0.3, 0.165), (-0.3, -0.165), (-0.05, -0.165), (-0.05, -0.5),
    (0.05, -0.5), (0.05, -0.165),
)  # fmt: skip


def mirrored(corners):
    return tuple((x, -y) for x, y in reversed(corners))


def corridor(side):
    """Return a corridor along x whose door is to the right, or with `side` -1 to the left."""
    cells = np.zeros((round(3.0 / SIDE_M), round(4.0 / SIDE_M)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    wall = len(cells) - 2 - round(CORRIDOR_M / SIDE_M)
    cells[wall] = 100
    half = round(0.5 * DOOR_M / SIDE_M)
    cells[wall, 80 - half : 80 + half] = 0
    return cells[:: int(side)]


def ends(body, side):
    """Return a start in the middle of the corridor, and a goal in the room beyond the door."""
    y_m = side * (3.0 - SIDE_M - 0.5 * CORRIDOR_M - 1.5) - 0.5 * (body.left_m - body.right_m)
    return SE2(0.7, 1.5 + y_m, 0.0), SE2(2.0, 1.5 - side * 0.6, -side * 0.5 * math.pi)


def assert_free(plan, body, cells):
    """Check against the walls, by shapely, 1 cm apart; a body's points may be half a cell apart."""
    rows, columns = np.nonzero(cells)
    walls = shapely.union_all(
        shapely.box(*(SIDE_M * np.array([columns, rows, columns + 1, rows + 1])))
    )
    shape = shapely.Polygon(body.corners).buffer(-0.5 * SIDE_M)
    for a, b in pairwise(plan.poses):
        turn = math.remainder(b[2] - a[2], math.tau)
        count = 2 + int(math.dist(a[:2], b[:2]) / 0.01 + abs(turn) / 0.02)
        for x, y, angle in a + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (*(b - a)[:2], turn):
            turned = shapely.affinity.rotate(shape, angle, origin=(0.0, 0.0), use_radians=True)
            assert not shapely.affinity.translate(turned, x, y).intersects(walls)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("planner", ["astar", "hybrid"])
def test_it_passes_a_door_away_from_its_arm_and_its_twin_the_one_on_the_other_side(planner, side):
    cells = corridor(side)
    towards, away = ARM_RIGHT, mirrored(ARM_RIGHT)
    if side < 0.0:
        towards, away = away, towards
    plan = PLANNERS[planner](PlannerConfig(turning_radius_m=0.3, margin_m=0.0)).plan
    body = Footprint(away)
    free = plan(PlanningMap(GridMap(cells, SIDE_M), body), *ends(body, side))
    assert isinstance(free, Plan)
    assert_free(free, body, cells)
    body = Footprint(towards)
    failure = plan(PlanningMap(GridMap(cells, SIDE_M), body), *ends(body, side))
    assert isinstance(failure, PlanFailure)
    assert failure.reason is Reason.NOT_FOUND
