"""The cells that zones and fences touch, against the separating axis theorem and by what drives."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.map.fence import MARGIN_M
from robotctl.planning.map.polygon_cells import polygon_cells
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed, speed_limits

SIDE_M = 0.1
UNCLEAR = 2e-6
"""Rounding may decide what is nearer than this to a boundary [m]."""


def grid(turn=0.0):
    return GridMap(np.zeros((20, 22), np.int8), SIDE_M, SE2(0.1, -0.2, turn))


def winds_round(corners, centres):
    """Return how often a polygon winds round each centre, and whether that is beyond doubt."""
    a = corners - centres[:, np.newaxis]
    b = np.roll(a, -1, axis=1)
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    turns = np.arctan2(cross, (a * b).sum(axis=2)).sum(axis=1) / math.tau
    side = np.hypot(*(b - a).transpose(2, 0, 1))
    return np.round(turns).astype(int), (np.abs(cross) > UNCLEAR * (side + 1.0)).all(axis=1)


def gaps(corners, centres, turn):
    """Return how far the nearest side of a polygon is from each square cell [m]; < 0: in it.

    The axes that may separate a line from a square are those of the square and the line's normal.
    """
    c, s = math.cos(turn), math.sin(turn)
    local = (corners - centres[:, np.newaxis]) @ np.array([[c, -s], [s, c]])
    ends = np.roll(local, -1, axis=1)
    middle, half = 0.5 * (local + ends), 0.5 * np.abs(ends - local)
    across = np.maximum(np.hypot(*half.transpose(2, 0, 1)), 1e-12)
    off = np.abs(middle[..., 0] * (ends - local)[..., 1] - middle[..., 1] * (ends - local)[..., 0])
    beyond = 0.5 * off / across - 0.5 * SIDE_M * half.sum(axis=2) / across
    box = np.abs(middle) - half - 0.5 * SIDE_M
    return np.maximum(box.max(axis=2), beyond).min(axis=1)


@given(
    st.lists(st.tuples(st.floats(-1, 3), st.floats(-1, 3)), min_size=3, max_size=7),
    st.floats(-3, 3),
)
def test_the_cells_are_those_inside_and_those_that_a_side_passes_through(corners, turn):
    found = polygon_cells(corners, grid(turn))
    centres = grid(turn).centre_of(np.argwhere(np.ones(grid().shape)))
    turns, is_clear = winds_round(np.array(corners), centres)
    assert np.array_equal(found.inside.ravel()[is_clear], (turns % 2 == 1)[is_clear])
    away = gaps(np.array(corners), centres, turn)
    sure = np.abs(away) > UNCLEAR
    assert np.array_equal(found.on_sides.ravel()[sure], (away < 0.0)[sure])
    assert np.array_equal(found.touched, found.inside | found.on_sides)


THIN = [
    ((0.51, -1.0), (0.53, -1.0), (0.53, 3.0), (0.51, 3.0)),
    ((0.6, -1.0), (0.6, 3.0), (0.6, -1.0)),
    ((-0.5, -0.5), (2.5, 2.5), (2.5, 2.502)),
]
"""A tape, one without width between two columns, and a sliver across the map."""


@pytest.mark.parametrize("corners", THIN)
def test_what_is_thinner_than_a_cell_leaves_no_gap_from_edge_to_edge(corners):
    cells = grid().cells.copy()
    cells[Closed((Zone("tape", corners),)).cells(grid())] = OCCUPIED
    areas, _ = ndimage.label(cells != OCCUPIED)
    assert areas[-1, 0] != areas[0, -1]
    limits = speed_limits(grid(), Closed((Zone("tape", corners, 0.1),)), 1.0)
    assert np.array_equal(np.isfinite(limits), cells == OCCUPIED)


def test_a_zone_smaller_than_a_cell_closes_it():
    dot = Zone("dot", ((0.92, 0.52), (0.93, 0.52), (0.93, 0.53)))
    assert np.argwhere(Closed((dot,)).cells(grid())).tolist() == [[7, 8]]


@pytest.mark.parametrize(
    "fence",
    [
        Fence((FencePolygon(THIN[0], keeps_in=False),)),
        Fence((), (FenceCircle(0.525, 0.505, 0.01, False),)),
    ],
)
def test_a_fence_excludes_what_is_smaller_than_a_cell_and_its_margin(fence):
    beyond = Closed((), fence).cells(grid())
    centres = grid().centre_of(np.argwhere(beyond))
    assert beyond[7, 4]
    assert np.abs(centres[:, 0] - 0.52).max() < MARGIN_M + 0.5 * SIDE_M


def test_the_name_of_what_closes_a_cell_is_that_of_a_zone_before_the_fence():
    closed = Closed((Zone("tape", THIN[0]),), Fence((), (FenceCircle(1.0, 0.5, 0.1, False),)))
    assert closed.what_closes(grid(), (7, 4)) == "the keep-out zone tape"
    assert closed.what_closes(grid(), (7, 9)) == "the fence"
    assert closed.what_closes(grid(), (7, 15)) == ""
