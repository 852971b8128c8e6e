"""The widest way, beside a search of all widths by connected areas."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from robotctl.planning.path.global_planning.widest_way import widest_way


def widest_by_areas(clearance, start, goal):
    """Return the greatest room with which the two hang together; None: they never do."""
    for room in sorted(set(clearance[clearance > 0.0].tolist()), reverse=True):
        areas, _ = ndimage.label(clearance >= room)
        if areas[start] and areas[start] == areas[goal]:
            return room
    return None


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(2, 12))
def test_no_way_is_wider_and_none_is_left_without_its_narrowest_place(seed, rows, columns):
    random = np.random.default_rng(seed)
    clearance = random.integers(-1, 5, (rows, columns)).astype(np.float32) + np.float32(0.5)
    clearance[clearance < 1.0] = -0.5
    start, goal = (tuple(random.integers((rows, columns)).tolist()) for _ in range(2))
    way = widest_way(clearance, start, goal)
    room = widest_by_areas(clearance, start, goal)
    assert (None if way is None else way[0]) == room
    if way is not None:
        assert clearance[way[1]] == room
        first, _ = ndimage.label(clearance > room)
        wider = ndimage.binary_dilation(first == first[start]) if first[start] else np.zeros(0)
        assert way[1] == start or wider[way[1]]  # it bounds all that is wider around the start


def test_of_ways_as_wide_the_shorter_one_is_named():
    clearance = np.full((9, 9), 3.0, np.float32)
    clearance[:, 4] = -0.5
    clearance[0, 4] = clearance[5, 4] = 1.0
    assert widest_way(clearance, (4, 1), (5, 7)) == (1.0, (5, 4))
