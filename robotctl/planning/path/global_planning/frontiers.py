"""Frontiers: where known free floor ends at unknown (Yamauchi 1997)."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Point

_EIGHT: Final = np.ones((3, 3), np.bool_)
_SEES_M: Final = 1.0
"""Distance from which the far side of a frontier is visible [m]."""


class Frontier(NamedTuple):
    """An opening to the unknown."""

    middle: Point
    """Middle of the frontier in `world` [m]."""
    place: Point
    """Place in `world` [m] from which the robot sees the frontier and has room to turn."""
    length_m: float


def frontiers(space: PlanningMap, here: Point, margin_m: float) -> list[Frontier]:
    """Return the frontiers of a map that the robot can go to, as it is wide.

    Parameters
    ----------
    space
        Of which unknown cells are not blocked.
    here
        Where the robot is, in `world` [m].
    margin_m
        Between the robot and obstacles at its place [m].
    """
    first, last = _known(space)
    cells = space.grid.cells[first[0] : last[0], first[1] : last[1]]
    clearance = space.clearance[first[0] : last[0], first[1] : last[1]]
    free, unknown = cells == 0, cells < 0
    wide = free & (clearance >= space.inscribed)
    floor = connected(space, wide, here, first)
    edge = floor & ndimage.binary_dilation(unknown)
    labels, count = ndimage.label(edge, _EIGHT)
    side_m = space.grid.resolution_m
    # On the robot's side of walls: from beyond them it would be a long way round, or none.
    roomy = np.argwhere(floor & (clearance >= space.circumscribed + margin_m / side_m))
    found: list[Frontier] = []
    for label, window in enumerate(ndimage.find_objects(labels, count), start=1):
        members = np.argwhere(labels[window] == label) + [each.start for each in window]
        if len(members) < 2.0 * space.inscribed or not len(roomy):
            continue
        middle = members[np.argmin(((members - members.mean(axis=0)) ** 2).sum(axis=1))]
        away = np.hypot(*(roomy - middle).T)
        nearest = int(np.argmin(away))
        if away[nearest] * side_m <= _SEES_M:
            at, place = (_point(space, each + first) for each in (middle, roomy[nearest]))
            found.append(Frontier(at, place, len(members) * side_m))
    return found


def connected(
    space: PlanningMap,
    wide: NDArray[np.bool_],
    here: Point,
    first: NDArray[np.int64] | tuple[int, int] = (0, 0),
) -> NDArray[np.bool_]:
    """Return the cells with room for the robot that it can reach from around a place in `world`.

    `wide` are those with room, from the row and column `first` of the map on.
    """
    areas, _ = ndimage.label(wide, _EIGHT)
    row, column = (space.grid.cell_of(np.array([here]))[0] - first).tolist()
    around = math.ceil(space.circumscribed) + 1
    low_row, low_column = max(row - around, 0), max(column - around, 0)
    near = areas[low_row : row + around + 1, low_column : column + around + 1]
    return np.isin(areas, near[near > 0])


def _known(space: PlanningMap) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first row and column of what is known, with one cell around, and those beyond."""
    known = space.grid.cells >= 0
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return np.zeros(2, np.int64), np.zeros(2, np.int64)
    low = np.maximum([rows[0] - 1, columns[0] - 1], 0)
    high = np.minimum([rows[-1] + 2, columns[-1] + 2], known.shape)
    return low, high


def _point(space: PlanningMap, cell: NDArray[np.int64]) -> Point:
    """Return the centre of a cell in `world`."""
    x_m, y_m = space.grid.centre_of(cell[np.newaxis])[0].tolist()
    return x_m, y_m


def known_area_m2(space: PlanningMap) -> float:
    """Return the area of the floor that is known to be free [m^2]."""
    return float((space.grid.cells == 0).sum()) * math.pow(space.grid.resolution_m, 2)
