"""Appearance of a place of a map, and its passages, in a frame of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap
from robotctl.planning.map.topological.graph import Exit, Passage, PlaceView, TopologicalPlace

BEARINGS: Final = 180
REACH_M: Final = 12.0
"""Maximum depth of a view [m]."""
SPACING_M: Final = 2.5
"""Maximum distance from any spot of a place to the nearest view [m]."""
_ROOM_M: Final = 0.4
"""Around the spot of a view, if the place has so much: a robot comes by there."""
_THROUGH_M: Final = 0.75
"""Cells of both places so near to a passage say which way leads through it."""


def described(
    grid: GridMap,
    labels: NDArray[np.int64],
    room_m: NDArray[np.float64],
    place: TopologicalPlace,
    passages: Sequence[Passage],
    numbers: Mapping[str, int],
) -> TopologicalPlace:
    """Return a place with its passages, where they are, and what it looks like.

    Parameters
    ----------
    grid, labels, room_m
        The map, the number of each cell's place, and how far each cell is from what is not free.
    place
        With the coordinates of its middle.
    passages
        All of the map, with coordinates.
    numbers
        Numbers of the places, by name.
    """
    mine = [each for each in passages if place.name in each.between]
    mine.sort(key=lambda each: _bearing_rad(place, each.x_m, each.y_m))
    # x of the frame points to the first passage.
    turn_rad = _bearing_rad(place, mine[0].x_m, mine[0].y_m) if mine else 0.0
    exits = []
    for passage in mine:
        heading_rad = _heading_out_rad(grid, labels, place, passage, numbers)
        bearing_deg, distance_m = _polar(place, turn_rad, passage.x_m, passage.y_m)
        exits.append(Exit(passage.name, bearing_deg, distance_m, _degrees(heading_rad - turn_rad)))
    number = numbers[place.name]
    views = [
        PlaceView(*_polar(place, turn_rad, x_m, y_m), seen_from(grid, x_m, y_m, turn_rad))
        for x_m, y_m in _spots(grid, (labels == number), room_m, (place.x_m, place.y_m))
    ]
    return replace(
        place,
        passages=tuple(each.name for each in mine),
        depth_m=seen_from(grid, place.x_m, place.y_m, turn_rad),
        exit=tuple(exits),
        view=tuple(views),
    )


def _bearing_rad(place: TopologicalPlace, x_m: float, y_m: float) -> float:
    return math.atan2(y_m - place.y_m, x_m - place.x_m)


def _degrees(angle_rad: float) -> float:
    return round(math.degrees(angle_rad), 1) % 360.0


def _polar(place: TopologicalPlace, turn_rad: float, x_m: float, y_m: float) -> tuple[float, float]:
    """Return bearing and distance from the middle of a place, in its frame [deg], [m]."""
    bearing_deg = _degrees(_bearing_rad(place, x_m, y_m) - turn_rad)
    return bearing_deg, round(math.hypot(x_m - place.x_m, y_m - place.y_m), 2)


def _heading_out_rad(
    grid: GridMap,
    labels: NDArray[np.int64],
    place: TopologicalPlace,
    passage: Passage,
    numbers: Mapping[str, int],
) -> float:
    """Return the heading of one who leaves a place through a passage, in `world`."""
    middles = {}
    for name in passage.between:
        cells = grid.centre_of(np.argwhere(labels == numbers[name]))
        away_m = np.hypot(cells[:, 0] - passage.x_m, cells[:, 1] - passage.y_m)
        middles[name] = cells[away_m <= _THROUGH_M].mean(axis=0)
    a, b = passage.between
    other = b if place.name == a else a
    x_m, y_m = (middles[other] - middles[place.name]).tolist()
    return math.atan2(y_m, x_m)


def _spots(
    grid: GridMap,
    inside: NDArray[np.bool_],
    room_m: NDArray[np.float64],
    middle: tuple[float, float],
) -> list[tuple[float, float]]:
    """Return spots beside the middle that cover a place, each the farthest from those before."""
    cells = np.argwhere(inside & (room_m >= _ROOM_M))
    if len(cells) == 0:
        return []
    points = grid.centre_of(cells)
    away_m = np.hypot(points[:, 0] - middle[0], points[:, 1] - middle[1])
    spots = []
    while away_m.max() > SPACING_M:
        x_m, y_m = points[np.argmax(away_m)].tolist()
        spots.append((x_m, y_m))
        away_m = np.minimum(away_m, np.hypot(points[:, 0] - x_m, points[:, 1] - y_m))
    return spots


def seen_from(grid: GridMap, x_m: float, y_m: float, turn_rad: float) -> tuple[float, ...]:
    """Return how far free floor reaches from a point of `world` [m].

    One of `BEARINGS` directions each, counter-clockwise from `turn_rad`, at most `REACH_M`.
    """
    ranges_m = np.arange(0.0, REACH_M, 0.25 * grid.resolution_m)
    bearings = turn_rad + np.arange(BEARINGS) * (math.tau / BEARINGS)
    x = x_m + np.multiply.outer(np.cos(bearings), ranges_m)
    y = y_m + np.multiply.outer(np.sin(bearings), ranges_m)
    cells = grid.cell_of(np.column_stack([x.ravel(), y.ravel()]))
    rows, columns = grid.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < rows) & (cells[:, 1] < columns)
    free = np.zeros(len(cells), np.bool_)
    free[inside] = grid.free()[cells[inside, 0], cells[inside, 1]]
    blocked = ~free.reshape(x.shape)
    seen_m = np.where(blocked.any(axis=1), ranges_m[blocked.argmax(axis=1)], REACH_M)
    return tuple(np.round(seen_m, 2).tolist())
