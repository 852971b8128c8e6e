"""Paths through doors that hardly leave room: straight, in line with the door, in its middle."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.gates import gated
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig, dense
from robotctl.planning.path.global_planning.planners import PLANNERS

SIDE_M = 0.05
BODY = Footprint(((0.35, -0.18), (0.35, 0.18), (-0.15, 0.18), (-0.15, -0.18)))
WIDTH_M = 0.36


def door(gap_m, thickness_m, aside_m):
    """Return two rooms of 4 m with a door between them: outer walls, and both jambs as boxes."""
    low, high = -2.0, 2.0
    outer = shapely.box(-4.0, low, 4.0, high)
    south = shapely.box(-thickness_m, low, 0.0, aside_m - 0.5 * gap_m)
    north = shapely.box(-thickness_m, aside_m + 0.5 * gap_m, 0.0, high)
    return outer, (south, north)


def walls_of(shapes, place):
    """Return the sides of shapes as walls in `world`, where their frame lies there."""
    rows = []
    for shape in shapes:
        corners = moved(place, np.array(shape.exterior.coords))
        rows.append(np.hstack([corners[:-1], corners[1:]]))
    return WallMap(np.concatenate(rows))


@pytest.mark.parametrize("planner", ["astar", "hybrid"])
@settings(max_examples=12, deadline=None)
@given(
    extra_m=st.floats(0.15, 0.2),
    thickness_m=st.floats(0.06, 0.2),
    aside_m=st.floats(-0.8, 0.8),
    angle=st.floats(-math.pi, math.pi),
    begin=st.tuples(st.floats(-3.3, -2.2), st.floats(-1.2, 1.2)),
    end=st.tuples(st.floats(2.2, 3.3), st.floats(-1.2, 1.2)),
)
def test_a_path_leads_straight_through_the_middle_of_a_door(
    planner, extra_m, thickness_m, aside_m, angle, begin, end
):
    place = SE2(1.3, -0.7, angle)
    outer, jambs = door(WIDTH_M + extra_m, thickness_m, aside_m)
    space = PlanningMap(grid_of_walls(walls_of((outer, *jambs), place), SIDE_M), BODY)
    start, goal = place @ SE2(*begin, 0.0), place @ SE2(*end, 0.0)
    config = PlannerConfig(turning_radius_m=0.5)
    answer = PLANNERS[planner](config).plan(space, start, goal)
    assert isinstance(answer, Plan)
    from_door = place.inverse()
    body = np.array(BODY.corners)
    for pose in dense(answer.poses, 0.02).tolist():
        here = from_door @ SE2(*pose)
        outline = shapely.Polygon(moved(here, body))
        least_m = min(outline.distance(jamb) for jamb in jambs)
        assert least_m > 0.5 * extra_m - SIDE_M, "in the middle there is half of it on each side"


def gates_of_a_corridor(rows, body):
    """Return the straight pieces along the middle of a corridor so many cells wide."""
    cells = np.zeros((80, 120), np.int8)
    cells[: 40 - rows // 2, 50:70] = cells[40 + (rows + 1) // 2 :, 50:70] = 100
    middle = np.column_stack([np.full(100, 40), np.arange(10, 110)])
    return list(gated(middle, PlanningMap(GridMap(cells, SIDE_M), body), 0.05))


def test_only_a_place_without_room_to_turn_or_for_the_margin_is_narrow():
    # A body of 0.36 m that turns in 0.79 m: with its margin and a cell on each side 0.56 m.
    assert len(gates_of_a_corridor(9, BODY)) == 1
    assert len(gates_of_a_corridor(11, BODY)) == 1
    assert not gates_of_a_corridor(13, BODY)
    assert not gates_of_a_corridor(7, BODY), "nothing fits"


@pytest.mark.parametrize("half_m", [0.0, 0.05])
def test_what_can_turn_wherever_it_fits_has_no_narrow_places(half_m):
    corners = ((half_m, -half_m), (half_m, half_m), (-half_m, half_m), (-half_m, -half_m))
    body = Footprint(corners if half_m else ())
    assert not any(gates_of_a_corridor(rows, body) for rows in (1, 3, 4, 5, 8))
