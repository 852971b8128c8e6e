"""The cells beyond the fence, and the paths that keep to it."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.fence_clearance import body_clearance
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.fence import MARGIN_M, beyond_fence
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.zones import Closed
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.safety.fence import fence_guard

SIDE_M = 0.1
places = st.floats(-1.5, 1.5)
corners = st.lists(st.tuples(places, places), min_size=3, max_size=6).map(tuple)
POINT = Footprint.rectangle(-1e-9, 1e-9, 1e-9)


@settings(max_examples=12)
@given(corners, st.booleans(), places, places, st.floats(0.1, 2.0), st.booleans())
def test_free_cells_are_those_whose_centre_keeps_the_margin(points, keeps_in, x, y, r, within):
    fence = Fence((FencePolygon(points, keeps_in),), (FenceCircle(x, y, r, within),))
    grid = GridMap(np.zeros((20, 24), np.int8), SIDE_M, SE2(-1.2, -1.0, 0.3))
    rows, columns = np.indices(grid.shape)
    local = SIDE_M * np.stack([columns + 0.5, rows + 0.5], -1).reshape(-1, 2)
    c, s = math.cos(0.3), math.sin(0.3)
    world = np.stack([c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1]], 1)
    poses = np.column_stack([world[:, 0] - 1.2, world[:, 1] - 1.0, np.zeros(len(world))])[::7]
    away_m = np.array([body_clearance(fence, POINT, pose[np.newaxis])[0] for pose in poses])
    free = ~beyond_fence(fence, grid).ravel()[::7]
    assert (away_m[free] > MARGIN_M - 1e-6).all()
    assert (away_m[~free] < MARGIN_M + 1e-6).all()


def test_a_path_goes_round_what_the_fence_excludes_and_farther_than_its_guard_asks():
    body = Footprint(((0.2, -0.18), (0.2, 0.18), (-0.2, 0.18), (-0.2, -0.18)))
    fence = Fence(
        (
            FencePolygon(((-2.0, -2.0), (4.0, -2.0), (4.0, 2.0), (-2.0, 2.0)), True),
            FencePolygon(((0.5, -3.0), (1.0, -3.0), (1.0, 0.5), (0.5, 0.5)), False),
        )
    )
    live = LayeredMap.without_map((-3.0, -3.0), (5.0, 3.0), 0.05, body, Closed((), fence))
    plan = PLANNERS["astar"](PlannerConfig()).plan(
        live.space(), SE2(-1.0, -1.0, 0.0), SE2(3.0, -1.0, 0.0)
    )
    assert isinstance(plan, Plan)
    for pose in plan.poses:
        away_m = body_clearance(fence, Footprint.rectangle(-0.2, 0.2, 0.18), pose[np.newaxis])[0]
        assert away_m > fence_guard.MARGIN_M
