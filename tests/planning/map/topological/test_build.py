"""Places found in maps are the rooms that are known to be there."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from robotctl.maps.localisation_map import load_localisation_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap
from robotctl.planning.map.topological.appearance import SPACING_M
from robotctl.planning.map.topological.build import build

RADIUS_M = 0.2
OFFICE = {
    "south 1": (3.0, 2.0),
    "south 2": (8.5, 3.2),
    "south 3": (14.0, 4.5),
    "south 4": (19.3, 3.1),
    "south 5": (24.5, 3.1),
    "north 1": (3.0, 13.2),
    "north 2": (8.5, 11.9),
    "north 3": (15.0, 11.0),
    "north 4": (20.0, 11.5),
    "corridor": (12.0, 7.5),
    "open area": (29.0, 12.5),
}
"""A spot in each room that `configs/worlds/office.toml` has between its walls."""


@cache
def of_world(name):
    grid = load_localisation_map(name, Path()).grid
    return grid, build(grid, RADIUS_M)


def rooms(*doors, columns=3):
    """Make a row of rooms of 4 m with doors of given widths [m] in the walls between them."""
    side = 20  # cells of 0.1 m
    side *= 2
    cells = np.full((side + 2, columns * (side + 2)), OCCUPIED, np.int8)
    for column in range(columns):
        begin = column * (side + 2) + 1
        cells[1:-1, begin : begin + side] = FREE
    for column, width_m in enumerate(doors):
        wall, half = (column + 1) * (side + 2) - 1, round(width_m / 0.2)
        middle = cells.shape[0] // 2
        cells[middle - half : middle + half, wall : wall + 2] = FREE
    return GridMap(cells, 0.1, SE2(-2.0, 1.0, 0.0))


def test_the_flat_has_two_rooms_and_a_door():
    grid, found = of_world("flat")
    left, right = found.place_at(grid, 2.0, 2.0), found.place_at(grid, 6.5, 2.5)
    assert {left, right} == {0, 1}
    assert len(found.map.places) == 2
    (door,) = found.map.passages
    assert (door.x_m, door.y_m) == pytest.approx((5.0, 2.5), abs=0.15)
    assert door.width_m == pytest.approx(1.0, abs=0.1)


def test_the_office_has_nine_rooms_a_corridor_and_an_open_area():
    grid, found = of_world("office")
    at = {name: found.place_at(grid, *spot) for name, spot in OFFICE.items()}
    assert sorted(at.values()) == list(range(len(found.map.places)))
    corridor = found.map.places[at["corridor"]]
    assert corridor.kind == "corridor"
    assert corridor.width_m == pytest.approx(2.2, abs=0.1)
    ends = {name for each in found.map.passages for name in each.between}
    assert ends == {place.name for place in found.map.places}
    assert all(corridor.name in each.between for each in found.map.passages)
    doors = [each for each in found.map.passages if found.map.places[at["open area"]].name
             not in each.between]  # fmt: skip
    assert all(each.width_m == pytest.approx(1.0, abs=0.1) for each in doors)
    assert len(doors) == 9


def test_passages_of_the_corridor_are_counted_as_one_walks_along_it():
    grid, found = of_world("office")
    name = {key: found.map.places[found.place_at(grid, *at)].name for key, at in OFFICE.items()}
    # Out of the room in the north-west, the open area lies left behind three doors.
    _, step = found.map.way(name["north 1"], name["open area"])
    assert step.left == 4
    _, step = found.map.way(name["south 1"], name["open area"])
    assert step.of - step.left == 5


@pytest.mark.parametrize(("width_m", "places"), [(0.8, 3), (1.2, 3), (3.6, 1)])
def test_doors_divide_and_wide_openings_do_not(width_m, places):
    found = build(rooms(width_m, width_m), RADIUS_M)
    assert len(found.map.places) == places
    assert len(found.map.passages) == places - 1


def test_where_the_robot_does_not_fit_is_no_passage():
    found = build(rooms(0.8, 0.2), RADIUS_M)
    assert len(found.map.places) == 3
    assert len(found.map.passages) == 1
    first, last = found.map.places[0].name, found.map.places[-1].name
    ways = [found.map.way(first, each.name) for each in found.map.places]
    assert sum(way is None for way in ways) == (1 if last != first else 0)


def test_two_doors_between_two_rooms_are_two_passages():
    grid = rooms(columns=2)
    cells = grid.cells.copy()
    cells[5:14, 41:43] = cells[28:37, 41:43] = FREE
    found = build(GridMap(cells, 0.1), RADIUS_M)
    assert len(found.map.places) == 2
    assert len(found.map.passages) == 2


def test_a_table_in_a_room_does_not_divide_it():
    grid = rooms(0.8, 0.8)
    cells = grid.cells.copy()
    cells[10:32, 15:27] = OCCUPIED
    assert len(build(GridMap(cells, 0.1), RADIUS_M).map.places) == 3


def test_a_wall_that_was_seen_with_holes_in_it_divides():
    grid = rooms()
    cells = np.repeat(np.repeat(grid.cells, 2, axis=0), 2, axis=1)  # of 0.05 m
    cells[:, 82:86] = FREE  # between the first two rooms no wall,
    cells[::5, 83] = cells[1::5, 83] = cells[2::5, 83] = OCCUPIED  # but what is left of one
    assert len(build(GridMap(cells, 0.05), RADIUS_M).map.places) == 3


def test_a_map_turned_in_the_world_has_the_same_places():
    grid = rooms(0.9, 1.1)
    turned = build(GridMap(grid.cells, 0.1, SE2(3.0, -1.0, 0.7)), RADIUS_M).map
    straight = build(grid, RADIUS_M).map
    for a, b in zip(straight.places, turned.places, strict=True):
        assert (a.name, a.area_m2, a.width_m) == (b.name, b.area_m2, b.width_m)
    for a, b in zip(straight.passages, turned.passages, strict=True):
        assert (a.between, a.width_m) == (b.between, b.width_m)


def test_a_place_looks_as_far_as_its_walls():
    place = build(rooms(columns=1), RADIUS_M).map.places[0]
    eighth = len(place.depth_m) // 8
    east, north_east, north = place.depth_m[0], place.depth_m[eighth], place.depth_m[2 * eighth]
    assert (east, north) == pytest.approx((2.0, 2.0), abs=0.15)
    assert north_east == pytest.approx(2.0 * 2**0.5, abs=0.2)


def test_exits_are_given_from_the_first_one_on():
    """In the middle room of three the doors are opposite, 2 m away, and straight through."""
    for turn_rad in (0.0, 2.1):  # of the map in the world: places do not know of it
        grid = rooms(0.8, 0.8)
        built = build(GridMap(grid.cells, 0.1, SE2(1.0, 2.0, turn_rad)), RADIUS_M).map
        place = next(each for each in built.places if len(each.passages) == 2)
        first, second = place.exit
        assert (first.bearing_deg, second.bearing_deg) == pytest.approx((0.0, 180.0), abs=3.0)
        assert (first.distance_m, second.distance_m) == pytest.approx((2.0, 2.0), abs=0.2)
        out = [np.exp(1j * np.radians(each.heading_deg)) for each in place.exit]
        assert out == pytest.approx([1.0, -1.0], abs=0.1)


def test_views_cover_a_place():
    grid, found = of_world("office")
    for number, place in enumerate(found.map.places):
        x, y = grid.centre_of(np.argwhere(found.labels == number)).T
        first = next(each for each in found.map.passages if each.name == place.passages[0])
        turn_rad = np.arctan2(first.y_m - place.y_m, first.x_m - place.x_m)
        away_m = np.hypot(x - place.x_m, y - place.y_m)
        for view in place.view:
            angle = turn_rad + np.radians(view.bearing_deg)
            at = (
                place.x_m + view.distance_m * np.cos(angle),
                (place.y_m + view.distance_m * np.sin(angle)),
            )
            away_m = np.minimum(away_m, np.hypot(x - at[0], y - at[1]))
        assert away_m.max() < SPACING_M + 1.0


def test_nothing_free_has_no_places():
    assert build(GridMap(np.full((30, 30), OCCUPIED, np.int8), 0.1), RADIUS_M).map.places == ()


def hall(*, shelves):
    """Return a hall of 24 m x 16 m, with two rows of shelves 7 m long and bays along a wall."""
    cells = np.full((162, 242), FREE, np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    if shelves:
        for x_m in (2.0, 6.0, 10.0):
            cells[10:80, round(10 * x_m) : round(10 * x_m) + 10] = OCCUPIED
        for y_m in (5.0, 10.0):
            cells[round(10 * y_m) : round(10 * y_m) + 3, 200:241] = OCCUPIED
    return GridMap(cells, 0.1, SE2())


def test_gaps_between_shelves_and_bays_of_a_hall_are_places_with_passages():
    grid = hall(shelves=True)
    found = build(grid, RADIUS_M)
    spots = {
        "hall": (8.0, 12.0),
        "gap": (4.5, 5.0),
        "other gap": (8.5, 5.0),
        "bay": (22.5, 7.8),
    }
    places = {name: found.place_at(grid, *spot) for name, spot in spots.items()}
    assert len(set(places.values())) == len(spots), places
    assert None not in places.values()
    ends = [set(passage.between) for passage in found.map.passages]
    middle = found.map.places[places["hall"]].name
    for name in ("gap", "other gap", "bay"):
        assert {middle, found.map.places[places[name]].name} in ends, name


def test_an_empty_hall_is_one_place():
    assert len(build(hall(shelves=False), RADIUS_M).map.places) == 1
