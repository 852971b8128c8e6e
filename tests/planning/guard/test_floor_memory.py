"""What is remembered of the floor around the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.guard.floor_memory import FloorMemory, FloorView

ANGLES = np.linspace(0.5, -0.5, 101)
CAMERA_X = 0.2


def sees(
    *things: tuple[float, float, float], sigma_m=0.01, nearest_m=0.3, trusted=True, camera_y=0.0
):
    """A view of things at (bearing, range from the camera, half width in rad)."""
    ranges = np.full(len(ANGLES), math.inf)
    for bearing, range_m, half in things:
        ranges[np.abs(ANGLES - bearing) <= half] = range_m
    return FloorView(
        CAMERA_X,
        camera_y,
        ANGLES,
        ranges,
        np.full(len(ANGLES), sigma_m),
        np.full(len(ANGLES), nearest_m),
        trusted,
    )


def around(memory, T_odom_base):
    return np.array(memory.around(T_odom_base)).reshape(-1, 2)


CUP = (0.0, 0.8, 0.05)


def test_a_thing_counts_when_two_pictures_in_a_row_show_it():
    memory = FloorMemory()
    memory.see(SE2(), sees(CUP))
    assert len(around(memory, SE2())) == 0
    memory.see(SE2(), sees(CUP))
    points = around(memory, SE2())
    assert points[:, 0] == pytest.approx(CAMERA_X + 0.8, abs=0.01)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.8 * math.sin(0.05), abs=0.01)


def test_two_pictures_of_two_things_one_behind_the_other_show_neither():
    memory = FloorMemory()
    memory.see(SE2(), sees(CUP))
    memory.see(SE2(), sees((0.0, 1.1, 0.05)))
    assert len(around(memory, SE2())) == 0


@given(
    theta=st.floats(-3.1, 3.1),
    bearing=st.floats(-0.4, 0.4),
    range_m=st.floats(0.4, 1.4),
    camera_y=st.floats(-0.3, 0.3),
)
def test_a_thing_is_where_the_camera_sees_it_however_the_robot_is_turned(
    theta, bearing, range_m, camera_y
):
    memory, here = FloorMemory(), SE2(2.0, -1.0, theta)
    for _ in range(2):
        memory.see(here, sees((bearing, range_m, 0.02), camera_y=camera_y))
    points = around(memory, here)
    at = CAMERA_X + range_m * math.cos(bearing), camera_y + range_m * math.sin(bearing)
    assert len(points) > 0
    assert np.hypot(*(points - at).T).max() < 0.021 * range_m + 1e-6


@given(theta=st.floats(-3.1, 3.1), turn=st.floats(-0.3, 0.3), bearing=st.floats(-0.15, 0.15))
def test_floor_frees_what_was_there_however_the_robot_has_turned(theta, turn, bearing):
    memory, here = FloorMemory(), SE2(2.0, -1.0, theta)
    for _ in range(2):
        memory.see(here, sees((bearing, 1.0, 0.02)))
    turned = here @ SE2(CAMERA_X, 0.0, 0.0) @ SE2(0.0, 0.0, turn) @ SE2(-CAMERA_X, 0.0, 0.0)
    elsewhere = bearing - turn + (0.3 if bearing < turn else -0.3)
    memory.see(turned, sees((bearing - turn, 1.0, 0.05), (elsewhere, 0.5, 0.02)))
    assert len(around(memory, turned)) > 0
    memory.see(turned, sees())
    assert len(around(memory, turned)) == 0


@pytest.mark.parametrize(("beyond_rad", "is_kept"), [(0.03, False), (0.05, True)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_lies_5_cm_beside_the_beams_is_not_seen(side, beyond_rad, is_kept):
    memory = FloorMemory()
    for _ in range(2):
        memory.see(SE2(), sees((0.0, 1.3, 0.001)))
    turn = -side * (ANGLES[0] + beyond_rad)
    turned = SE2(CAMERA_X, 0.0, 0.0) @ SE2(0.0, 0.0, turn) @ SE2(-CAMERA_X, 0.0, 0.0)
    memory.see(turned, sees())
    assert (len(around(memory, turned)) > 0) is is_kept


def test_a_range_that_is_a_little_longer_frees_nothing():
    memory = FloorMemory()
    for range_m in (0.8, 0.8, 0.85):
        memory.see(SE2(), sees((0.0, range_m, 0.05)))
    assert around(memory, SE2())[:, 0].min() == pytest.approx(CAMERA_X + 0.8, abs=0.01)


def test_it_is_kept_while_the_robot_drives_so_near_that_the_camera_loses_it():
    memory = FloorMemory()
    for _ in range(2):
        memory.see(SE2(), sees(CUP))
    for step in range(10):
        cup = [(0.0, 0.8 - 0.06 * step, 0.06)] if step < 7 else []
        memory.see(SE2(0.06 * step, 0.0, 0.0), sees(*cup, nearest_m=0.4))
    points = around(memory, SE2(0.54, 0.0, 0.0))
    assert points[:, 0].min() == pytest.approx(CAMERA_X + 0.8 - 0.54, abs=0.02)


def test_it_is_forgotten_where_the_camera_sees_floor_now():
    memory = FloorMemory()
    for view in (sees(CUP), sees(CUP), sees()):
        memory.see(SE2(), view)
    assert len(around(memory, SE2())) == 0


def test_a_picture_that_is_not_trusted_shows_what_may_be_there_but_no_floor():
    memory = FloorMemory()
    for view in (sees(CUP, trusted=False), sees(CUP, trusted=False), sees(trusted=False)):
        memory.see(SE2(), view)
    assert len(around(memory, SE2())) > 0


def test_floor_behind_another_thing_or_beside_the_beams_or_too_near_to_be_seen_is_not_seen():
    for later in (
        sees((0.0, 0.5, 0.1)),  # something stands before it
        sees(nearest_m=1.0),  # the picture begins behind it
    ):
        memory = FloorMemory()
        for view in (sees(CUP), sees(CUP), later):
            memory.see(SE2(), view)
        assert np.any(np.abs(around(memory, SE2())[:, 0] - 1.0) < 0.02)
    memory = FloorMemory()
    for _ in range(2):
        memory.see(SE2(), sees(CUP))
    memory.see(SE2(0.2, 0.0, 1.2), sees())  # looks elsewhere
    assert len(around(memory, SE2())) > 0


def test_what_is_far_or_vague_is_not_taken_in_and_what_is_left_behind_is_forgotten():
    memory = FloorMemory()
    for _ in range(2):
        memory.see(SE2(), sees((0.0, 1.6, 0.1)))
        memory.see(SE2(), sees(CUP, sigma_m=0.2))
    assert len(around(memory, SE2())) == 0
    for _ in range(2):
        memory.see(SE2(), sees(CUP))
    memory.see(SE2(-1.5, 0.0, math.pi), sees())
    assert len(around(memory, SE2())) == 0


@given(
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
    theta=st.floats(-3.1, 3.1),
    bearing=st.floats(-0.4, 0.4),
    range_m=st.floats(0.4, 1.4),
)
def test_points_stay_where_they_are_when_the_robot_moves(x, y, theta, bearing, range_m):
    memory = FloorMemory()
    seen_from, moved = SE2(x, y, theta), SE2(x, y, theta) @ SE2(0.1, -0.05, 0.3)
    for _ in range(2):
        memory.see(seen_from, sees((bearing, range_m, 0.02)))
    before, after = around(memory, seen_from), around(memory, moved)
    expected = [(seen_from.inverse() @ moved).inverse().apply(*point) for point in before.tolist()]
    assert after == pytest.approx(np.array(expected), abs=1e-9)
    assert len(before) > 0


def test_a_robot_that_stands_before_a_wall_keeps_no_more_points_than_the_wall_has():
    memory = FloorMemory()
    rng = np.random.default_rng(1)
    for _ in range(500):
        memory.see(SE2(), sees((0.0, 0.8 + 0.01 * rng.normal(), 0.5)))
    assert len(around(memory, SE2())) < 200
