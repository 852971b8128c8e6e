"""The way out of what is too near, against the geometry of two rectangles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.planning.path.local.body import make_body
from robotctl.planning.path.local.escape import intrusions, separation

SIDE_M = 0.05
FRONT, REAR, HALF = 4.0, 3.0, 3.6
"""Of the body from `base` [cells]."""
BODY = Footprint(
    tuple((x * SIDE_M, y * SIDE_M) for x, y in
          ((FRONT, -HALF), (FRONT, HALF), (-REAR, HALF), (-REAR, -HALF)))
)  # fmt: skip
MIDDLE = 20.0


def cells(*blocked):
    grid = np.zeros((40, 40), np.bool_)
    for row, column in blocked:
        grid[row, column] = True
    return grid


def bare():
    return make_body(BODY, 0.0, SIDE_M)


@given(st.floats(-1.9, 3.0), st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2]))
def test_a_row_of_cells_ahead_is_as_far_as_the_nose_is_from_it(gap, heading):
    row = [(int(MIDDLE), k) for k in range(40)]
    blocked = cells(*row) if abs(math.sin(heading)) > 0.5 else cells(*[(k, r) for r, k in row])
    away = gap + FRONT
    c, s = math.cos(heading), math.sin(heading)
    edge = MIDDLE if c + s > 0.5 else MIDDLE + 1.0
    x, y = (edge - c * away, 10.5) if abs(c) > 0.5 else (10.5, edge - s * away)
    assert separation(blocked, bare(), x, y, c, s) == pytest.approx(min(gap, 2.0), abs=1e-9)


def test_what_is_at_a_corner_is_as_far_as_the_corner_is_along_a_side():
    blocked = cells((26, 26))
    apart = separation(blocked, bare(), 26.0 - FRONT - 0.5, 26.0 - HALF - 0.25, 1.0, 0.0)
    assert apart == pytest.approx(0.5)


@pytest.mark.parametrize("depth", [0.2, 0.9])
def test_a_wall_beside_reaches_in_at_its_own_side_only(depth):
    wall = cells(*[(23, k) for k in range(40)])
    pose = (MIDDLE, 23.0 - HALF + depth, 0.0)
    found = dict(zip(("front", "left", "rear", "right"), _by_side(wall, pose), strict=True))
    assert found["left"] == pytest.approx(depth)
    assert found["right"] == pytest.approx(-2.0)
    assert max(found["front"], found["rear"]) <= depth


def _by_side(blocked, pose):
    """Return `intrusions` by the side that a normal points to: front, left, rear, right."""
    body = bare()
    depths = intrusions(blocked, body, pose, 2.0)
    ways = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
    return [depths[int(np.argmax(body.sides[:, :2] @ way))] for way in ways]
