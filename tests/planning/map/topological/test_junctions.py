"""Junctions are where corridors made by hand meet, and nowhere else."""

import math

import numpy as np
import pytest
from scipy import ndimage

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.planning.map.topological.build import build

SIDE_M = 0.05
RADIUS_M = 0.2
ALONG = (-9.0, -1.0, 9.0, 1.0)
"""A corridor through the origin, 2 m wide."""
UP, DOWN = (-1.0, 0.0, 1.0, 8.0), (-1.0, -8.0, 1.0, 0.0)
SIDES = ((0.0, 0.0, 14.0, 2.0), (0.0, 8.0, 14.0, 10.0))
RING = (*SIDES, (0.0, 0.0, 2.0, 10.0), (12.0, 0.0, 14.0, 10.0))
MEETINGS = {
    "a crossing": ((ALONG, UP, DOWN), {(0.0, 0.0): 4}),
    "a branch": ((ALONG, DOWN), {(0.0, 0.0): 3}),
    "a corner": (((-9.0, -1.0, 1.0, 1.0), DOWN), {(0.0, 0.0): 2}),
    "a narrower branch": ((ALONG, (-0.7, -8.0, 0.7, 0.0)), {(0.0, 0.0): 3}),
    "two branches": (
        ((-9.0, -1.0, 12.0, 1.0), (-4.0, -8.0, -2.0, 0.0), (4.0, 0.0, 6.0, 8.0)),
        {(-3.0, 0.0): 3, (5.0, 0.0): 3},
    ),
    "a ring": (RING, {(1.0, 1.0): 2, (13.0, 1.0): 2, (1.0, 9.0): 2, (13.0, 9.0): 2}),
}
"""Boxes of floor; where junctions are, and how many ways lead off each."""
NO_MEETINGS = {
    "a corridor": (ALONG,),
    "an alcove": (ALONG, (-1.0, 1.0, 1.0, 2.5)),
    "a room": ((-4.0, -3.0, 4.0, 3.0),),
    "rooms behind doors": (
        *(ALONG, (-6.0, 1.15, -1.0, 6.0), (-4.0, 0.9, -3.0, 1.2)),
        *((1.0, -7.0, 3.0, -1.15), (1.5, -1.2, 2.5, -0.9)),
    ),
    "a hall at a corridor": (ALONG, (-4.0, 0.0, 4.0, 8.0)),
}


def floor(boxes, turn_rad=0.0):
    """Make a map of boxes of floor, turned about the origin."""
    corners = np.array([(x, y) for ax, ay, bx, by in boxes for x in (ax, bx) for y in (ay, by)])
    reach_m = float(np.hypot(*corners.T).max()) + 0.3
    line = np.arange(-reach_m, reach_m, SIDE_M) + 0.5 * SIDE_M
    x, y = np.meshgrid(line, line)
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    x, y = c * x + s * y, c * y - s * x
    free = np.zeros(x.shape, np.bool_)
    for ax, ay, bx, by in boxes:
        free |= (x > ax) & (x < bx) & (y > ay) & (y < by)
    cells = np.where(free, FREE, OCCUPIED).astype(np.int8)
    return GridMap(cells, SIDE_M, SE2(-reach_m, -reach_m, 0.0))


def scanned(grid, rng):
    """Return a map as scans make it: ragged walls, unknown specks, and beams through glass."""
    walls_m = ndimage.distance_transform_edt(grid.free()) * SIDE_M
    cells = grid.cells.copy()
    cells[(walls_m > 0) & (walls_m < 2.5 * SIDE_M) & (rng.random(cells.shape) < 0.3)] = OCCUPIED
    cells[rng.random(cells.shape) < 0.002] = UNKNOWN
    rows, columns = np.nonzero((walls_m > 0) & (walls_m <= SIDE_M))
    for spot in rng.choice(len(rows), 8):
        steps = np.arange(0.0, 5.0, 0.5 * SIDE_M) / SIDE_M
        angle = rng.uniform(-math.pi, math.pi)
        row = np.clip(rows[spot] + steps * math.sin(angle), 0, cells.shape[0] - 1).astype(int)
        column = np.clip(columns[spot] + steps * math.cos(angle), 0, cells.shape[1] - 1).astype(int)
        cells[row, column] = FREE
    return GridMap(cells, SIDE_M, grid.origin)


def check(found, wanted, turn_rad=0.0):
    """Check that junctions, their ways, and the corridors between are those of the boxes."""
    junctions = [place for place in found.places if place.kind == "junction"]
    assert len(junctions) == len(wanted)
    for (x_m, y_m), ways in wanted.items():
        at = SE2(0.0, 0.0, turn_rad) @ SE2(x_m, y_m, 0.0)
        near = min(junctions, key=lambda each: math.hypot(each.x_m - at.x_m, each.y_m - at.y_m))
        assert math.hypot(near.x_m - at.x_m, near.y_m - at.y_m) < 0.6
        assert len(near.passages) == ways
    others = [place.kind for place in found.places if place.kind != "junction"]
    assert others.count("corridor") == len(others)
    for passage in found.passages:
        kinds = {place.kind for place in found.places if place.name in passage.between}
        assert kinds == {"corridor", "junction"}


@pytest.mark.parametrize("turn_rad", [0.0, 0.5])
@pytest.mark.parametrize("name", MEETINGS)
def test_corridors_meet_in_a_junction(name, turn_rad):
    boxes, wanted = MEETINGS[name]
    check(build(floor(boxes, turn_rad), RADIUS_M).map, wanted, turn_rad)


@pytest.mark.parametrize("name", MEETINGS)
def test_junctions_are_the_same_in_a_map_of_scans(name):
    boxes, wanted = MEETINGS[name]
    grid = scanned(floor(boxes, turn_rad := 0.9), np.random.default_rng(3))
    check(build(grid, RADIUS_M).map, wanted, turn_rad)


@pytest.mark.parametrize("name", NO_MEETINGS)
def test_elsewhere_is_no_junction(name):
    found = build(floor(NO_MEETINGS[name]), RADIUS_M).map
    assert {place.kind for place in found.places} <= {"corridor", "room"}


def test_a_door_between_two_corridors_is_a_passage_and_no_junction():
    door = (-0.5, -1.2, 0.5, -0.9)
    found = build(floor((ALONG, (-1.0, -8.0, 1.0, -1.15), door)), RADIUS_M).map
    assert len(found.places) == 2
    assert len(found.passages) == 1
    assert "junction" not in {place.kind for place in found.places}


def test_a_way_says_where_to_turn():
    """From the west to the south at a crossing: of four ways the third to the left."""
    grid = floor(MEETINGS["a crossing"][0])
    built = build(grid, RADIUS_M)
    west, south = (
        built.map.places[built.place_at(grid, *at)].name for at in ((-6.0, 0.0), (0.0, -6.0))
    )
    into, out = built.map.way(west, south)
    assert (into.place.kind, into.left) == ("junction", None)
    assert (out.place.name, out.left, out.of) == (south, 3, 4)
