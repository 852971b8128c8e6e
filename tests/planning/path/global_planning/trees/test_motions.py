"""Straight motions of the random trees, against a dense walk."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robotctl.planning.map.planning_map import clearance_of
from robotctl.planning.path.global_planning.trees.motions import (
    free_share,
)


def check_free_share(clearance, radius, ends):
    """Check a share by a dense walk, which may step over the corner of a cell that is grazed."""
    share = free_share(clearance, radius, *ends)
    way = ends[2:] - ends[:2]
    cells = np.floor(ends[:2] + np.linspace(0.0, 1.0, 20_001)[:, np.newaxis] * way).astype(int)
    hits = clearance[cells[:, 1], cells[:, 0]] < max(radius, 1e-9)
    first = np.argmax(hits) / 20_000 if hits.any() else 1.0
    assert share <= first + 1e-9
    if share < first - 1e-4:  # the walk stepped over a corner
        x, y = ends[:2] + share * way
        near = [
            (math.floor(y + dy), math.floor(x + dx)) for dx in (-1e-6, 1e-6) for dy in (-1e-6, 1e-6)
        ]
        assert min(clearance[cell] for cell in near) < max(radius, 1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.4))
def test_a_piece_is_free_as_far_as_a_dense_walk_finds_it(seed, density):
    rng = np.random.default_rng(seed)
    clearance = clearance_of(rng.random((40, 40)) < density)
    for _ in range(10):
        check_free_share(clearance, 0.0, rng.uniform(0.0, 40.0, 4))


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 3.0))
def test_a_wider_robot_needs_its_clearance_all_along(seed, radius):
    rng = np.random.default_rng(seed)
    clearance = clearance_of(rng.random((60, 60)) < 0.02)
    check_free_share(clearance, radius, rng.uniform(0.0, 60.0, 4))
