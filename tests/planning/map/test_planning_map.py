"""Where a body collides, against the separating axes of polygon and cell; conversions of frames."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap

BODY = Footprint(((0.5, -0.2), (0.5, 0.2), (-0.2, 0.2), (-0.2, -0.2)))


def overlap_m(corners, low, high):
    """Return by how much a convex polygon and a box overlap; below 0: they are apart."""
    box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    axes = [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([b[1] - a[1], a[0] - b[0]])
        axes.append(normal / np.linalg.norm(normal))
    return min(
        min((corners @ axis).max(), (box @ axis).max())
        - max((corners @ axis).min(), (box @ axis).min())
        for axis in axes
    )


@given(st.integers(0, 2**32 - 1))
def test_a_body_collides_where_it_overlaps_a_blocked_cell(seed):
    rng = np.random.default_rng(seed)
    side_m = 0.1
    cells = np.where(rng.random((24, 24)) < 0.04, 100, 0).astype(np.int8)
    space = PlanningMap(GridMap(cells, side_m), BODY)
    poses = np.column_stack([rng.uniform(7, 17, (20, 2)), rng.uniform(-math.pi, math.pi, 20)])
    hits = space.collides(poses)
    gaps = space.gaps_m(poses)
    for (x, y, theta), hit, gap_m in zip(poses, hits, gaps, strict=True):
        c, s = math.cos(theta), math.sin(theta)
        turn = np.array([[c, -s], [s, c]])
        corners = np.array(BODY.corners) @ turn.T + side_m * np.array([x, y])
        deepest = max(
            (
                overlap_m(corners, (side_m * q, side_m * r), (side_m * (q + 1), side_m * (r + 1)))
                for r, q in np.argwhere(cells)
            ),
            default=-1.0,
        )
        if hit:
            assert deepest > -1e-9
            assert gap_m == 0.0
        else:  # a corner of a cell may reach in between two points of the body
            assert deepest < 0.6 * side_m
        if gap_m > 0.0:
            assert gap_m <= -deepest * math.sqrt(2.0) + 1.3 * side_m


def test_what_lies_off_the_map_is_blocked():
    space = PlanningMap(GridMap(np.zeros((10, 10), np.int8), 0.1), BODY)
    poses = np.array([[4.9, 5.0, 0.0], [6.0, 5.0, 0.0], [-3.0, 5.0, 0.0]])
    assert space.collides(poses).tolist() == [False, True, True]


def test_unknown_cells_are_blocked_unless_the_robot_may_pass_them():
    cells = np.full((9, 9), -1, np.int8)
    grid = GridMap(cells, 1.0)
    assert PlanningMap(grid, Footprint()).blocked.all()
    assert not PlanningMap(grid, Footprint(), through_unknown=True).blocked.any()


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3), st.floats(-3, 3))
def test_poses_go_to_cells_and_back(x_m, y_m, theta, origin_rad):
    grid = GridMap(np.zeros((40, 30), np.int8), 0.2, SE2(1.0, -2.0, origin_rad))
    space = PlanningMap(grid, Footprint())
    there = space.to_cells(SE2(x_m, y_m, theta))
    (back,) = space.to_world(np.array([[there.x_m, there.y_m, there.theta_rad]]))
    assert back[:2] == pytest.approx((x_m, y_m), abs=1e-9)
    assert math.remainder(back[2] - theta, math.tau) == pytest.approx(0.0, abs=1e-9)
    row, column = grid.cell_of(np.array([[x_m, y_m]]))[0]
    assert (there.x_m - column, there.y_m - row) == pytest.approx((0.5, 0.5), abs=0.5 + 1e-9)
