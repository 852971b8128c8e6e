"""Discs of floor, against the distances of all cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.planning.map.discs import Disc, close_disc, raise_in_disc
from robotctl.planning.map.planning_map import clearance_of

SHAPE = (30, 40)
DISCS = st.builds(
    Disc, x=st.floats(-8.0, 48.0), y=st.floats(-8.0, 38.0), radius=st.floats(2.0, 9.0)
)


def inside(disc):
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.hypot(rows + 0.5 - disc.y, columns + 0.5 - disc.x) <= disc.radius


@settings(max_examples=80, deadline=None)
@given(disc=DISCS, price=st.floats(1.0, 50.0))
def test_the_cells_in_a_disc_are_so_dear_and_no_others(disc, price):
    prices = np.full(SHAPE, 3.0, np.float32)
    raise_in_disc(prices, disc, price)
    wanted = np.where(inside(disc), max(np.float32(price), np.float32(3.0)), 3.0)
    assert prices == pytest.approx(wanted)


@settings(max_examples=80, deadline=None)
@given(disc=DISCS, seed=st.integers(0, 99))
def test_a_closed_disc_blocks_its_cells_and_the_clearance_tells_of_it(disc, seed):
    blocked = np.random.default_rng(seed).random(SHAPE) < 0.02
    clearance, wanted = clearance_of(blocked), blocked | inside(disc)
    close_disc(blocked, clearance, disc, 6.0)
    assert (blocked == wanted).all()
    exact = clearance_of(wanted)
    near = exact < 4.0
    # The disc is round, and its cells are square.
    assert (np.abs(clearance - exact)[near & (exact > 0.0)] < 1.3).all()
    assert (clearance[wanted] <= 0.0).all()
