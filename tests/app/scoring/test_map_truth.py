"""Walls that can be mapped are those that a robot, wherever it gets to, can see."""

import math

import numpy as np
import pytest

from firmware_sim.world.world import load_world
from robotctl.app.scoring.map_truth import PIECE_M, SPACING_M, MapTruth, reachable, visible_walls
from robotctl.estimation.grid.map_quality import wall_cells
from robotctl.maps.map_file import save_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.wall_map import WallMap

RADIUS_M = 0.2
START = SE2(2.0, 3.0, 0.0)


def ring(low_x, low_y, high_x, high_y):
    """Return the sides of a rectangle."""
    corners = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)]
    return [(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


ROOM = ring(0.0, 0.0, 10.0, 6.0)


def seen(walls, fences=(), reach_m=30.0):
    """Return the part of each wall that can be seen, 0 to 1; fences are too low to be seen."""
    sides = np.array(walls, float)
    spots = reachable(np.array([*walls, *fences], float), START, RADIUS_M)
    pieces = visible_walls(sides, spots, reach_m).segments
    middles = 0.5 * (pieces[:, :2] + pieces[:, 2:])
    shares = []
    for ax, ay, bx, by in walls:
        length_m = math.hypot(bx - ax, by - ay)
        across = (middles[:, 0] - ax) * (by - ay) - (middles[:, 1] - ay) * (bx - ax)
        along = (middles[:, 0] - ax) * (bx - ax) + (middles[:, 1] - ay) * (by - ay)
        on = (np.abs(across) < 1e-6) & (along > 0.0) & (along < length_m**2)
        lengths_m = np.hypot(*(pieces[on, 2:] - pieces[on, :2]).T)
        shares.append(lengths_m.sum() / length_m)
    return shares


def test_a_room_and_a_box_in_it_are_seen_all_round():
    assert seen([*ROOM, *ring(5.0, 2.0, 6.0, 3.0)]) == pytest.approx([1.0] * 8)


def test_a_closet_that_nobody_can_look_into_is_not_seen_inside():
    """Its outside is, but for what stands at the walls of the room."""
    outside, inside = ring(7.0, 3.0, 10.0, 6.0), ring(7.1, 3.1, 9.9, 5.9)
    chest = ring(8.0, 4.0, 9.0, 5.0)
    shares = seen([*ROOM, *outside, *inside, *chest])
    room, closet = shares[:4], shares[4:8]
    assert shares[8:] == [0.0] * 8
    assert closet == pytest.approx([1.0, 0.0, 0.0, 1.0], abs=0.03)
    assert room == pytest.approx([1.0, 0.5, 0.7, 1.0], abs=0.03)


def test_of_a_thin_wall_the_side_in_a_closed_void_is_not_seen():
    """Seen from the start: the face at x = 6; the one behind it looks into a void."""
    shares = seen([*ROOM, (6.0, 0.0, 6.0, 6.0), (6.1, 0.0, 6.1, 6.0)])
    assert shares[4:] == pytest.approx([1.0, 0.0])
    assert shares[:4] == pytest.approx([0.6, 0.0, 0.6, 1.0], abs=0.01)


def test_a_bare_wall_that_is_seen_from_one_side_is_seen():
    assert seen([*ROOM, (6.0, 0.0, 6.0, 6.0)])[4] == pytest.approx(1.0)


def test_the_room_behind_a_slit_that_is_too_narrow_to_enter_is_seen_through_it():
    slit = [(6.0, 0.0, 6.0, 2.9), (6.0, 3.1, 6.0, 6.0)]
    assert seen([*ROOM, *slit])[1] == pytest.approx(1.0)
    assert seen([*ROOM, (6.0, 0.0, 6.0, 6.0)])[1] == 0.0


def test_farther_than_its_reach_the_sensor_sees_nothing():
    """Held by a fence at x = 2, the robot sees 5 m from its nearest spot."""
    fence = [(2.0, 0.0, 2.0, 6.0)]
    south, east, north, west = seen(ROOM, fence, reach_m=5.0)
    at_x_m, off_m = 2.0 - RADIUS_M, RADIUS_M
    reach_m = at_x_m + math.sqrt(5.0**2 - off_m**2)
    for share in (south, north):
        assert share * 10.0 == pytest.approx(reach_m, abs=0.15)
        assert share * 10.0 <= reach_m + PIECE_M
    assert (east, west) == (0.0, pytest.approx(1.0))


def test_a_room_behind_a_door_counts_if_the_robot_fits_through_it():
    for width_m, share in ((0.7, 1.0), (0.3, 0.0)):
        wall = [(6.0, 0.0, 6.0, 1.0), (6.0, 1.0 + width_m, 6.0, 6.0)]
        # What is seen from the door only, behind a screen.
        screen = [(6.5, 0.0, 6.5, 4.5)]
        nook = [(9.0, 0.5, 9.5, 0.5)]
        shares = seen([*ROOM, *wall, *screen, *nook])
        assert shares[-1] == pytest.approx(share)


def test_in_a_world_that_is_a_map_the_robot_gets_to_free_cells_only(tmp_path):
    """A wall ends where nothing is known: that is no way out."""
    cells = np.full((80, 120), UNKNOWN, np.int8)
    cells[10:70, 10:110] = OCCUPIED
    cells[12:68, 12:108] = FREE
    cells[30:50, 108:] = UNKNOWN
    save_map(tmp_path / "map", GridMap(cells, 0.05))
    world = load_world(tmp_path / "map.yaml")
    spots = reachable(world.touchable, SE2(3.0, 2.0, 0.0), RADIUS_M, world.cells)
    assert len(spots) == pytest.approx(2.4 * 4.4 / SPACING_M**2, rel=0.15)
    low, high = spots.min(axis=0), spots.max(axis=0)
    assert low == pytest.approx((0.8, 0.8), abs=0.21)
    assert high == pytest.approx((5.4, 3.2), abs=0.21)


def grid_of(walls, up_to_x_m=math.inf):
    """Return a map of walls, of what lies no farther east."""
    grid = GridMap(np.full((180, 260), FREE, np.int8), 0.05, SE2(-1.0, -1.0, 0.0))
    at = wall_cells(grid, WallMap(np.array(walls, float)))
    at = at[grid.centre_of(at)[:, 0] <= up_to_x_m]
    cells = grid.cells.copy()
    cells[tuple(at.T)] = OCCUPIED
    return GridMap(cells, 0.05, grid.origin)


def truth_of(walls):
    sides = np.array(walls, float)
    spots = reachable(sides, START, RADIUS_M)
    return MapTruth(WallMap(sides), lambda: visible_walls(sides, spots, 12.0))


CLOSET = [*ROOM, *ring(7.0, 3.0, 9.5, 5.5), *ring(7.2, 3.2, 9.3, 5.3)]


def test_a_map_without_the_insides_is_complete_and_one_without_a_side_is_not():
    outside = CLOSET[:8]
    assert truth_of(CLOSET).quality(grid_of(outside)).recall == 1.0
    lengths_m = np.array([math.hypot(bx - ax, by - ay) for ax, ay, bx, by in outside])
    lacking = truth_of(CLOSET).quality(grid_of(outside, up_to_x_m=9.7))
    assert lacking.recall == pytest.approx(1.0 - 6.3 / lengths_m.sum(), abs=0.01)
    assert lacking.precision == 1.0


def test_a_turned_map_is_good_once_it_is_laid_over():
    turned = SE2(0.1, -0.05, math.radians(1.0)) @ SE2(-1.0, -1.0, 0.0)
    straight = grid_of(CLOSET[:8])
    quality = truth_of(CLOSET).quality(GridMap(straight.cells, 0.05, turned))
    assert quality.precision < 0.8
    assert (quality.aligned_precision, quality.aligned_recall) == pytest.approx((1.0, 1.0))


def test_a_bent_map_is_not_good_wherever_it_is_laid():
    """One wall is 0.3 m off: no motion makes up for that."""
    bent = [(0.0, 0.3, 10.0, 0.3), *CLOSET[1:8]]
    quality = truth_of(CLOSET).quality(grid_of(bent))
    assert quality.aligned_precision < 0.9
    assert quality.aligned_recall < 0.9


@pytest.mark.parametrize("is_mapped", [True, False])
def test_what_is_too_low_for_the_sensor_may_be_in_the_map_or_not(is_mapped):
    low = ring(4.0, 4.0, 4.5, 4.5)
    seen_sides = np.array(ROOM, float)
    spots = reachable(np.array([*ROOM, *low], float), START, RADIUS_M)
    truth = MapTruth(
        WallMap(np.array([*ROOM, *low], float)), lambda: visible_walls(seen_sides, spots, 12.0)
    )
    quality = truth.quality(grid_of([*ROOM, *low] if is_mapped else ROOM))
    assert (quality.precision, quality.recall) == (1.0, 1.0)
