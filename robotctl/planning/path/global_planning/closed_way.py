"""Ways that something which is on no map closes now: how far they are free, and what stands there.

The path is planned over the map as it was given, where what the sensors have marked may be passed
but costs much. So it leads round what can be passed, and through what closes every way. It ends
before that.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.body_cells import cells_at
from robotctl.planning.map.doors import RADIUS_M
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, dense

_PRICE: Final = 50.0
"""Price of a metre through what closes the way, in free metres."""
_STAND_OFF_M: Final = 0.5
"""Distance along the path from the end of the free part to the first contact [m]."""
_SHORTEST_M: Final = 0.2
"""Shortest free part that is driven [m]."""
_PERSON_RANGE_M: Final = 0.7
"""Distance within which something that moves is taken for what closes the way [m]."""
_EIGHT: Final = np.ones((3, 3), np.bool_)


class ClosedWay(NamedTuple):
    """The way to a goal, and what closes it."""

    plan: Plan | None
    """Its free part; None: the robot is there already."""
    text: str
    """Names the obstacle and its place."""


def priced(given: PlanningMap, live: PlanningMap) -> PlanningMap:
    """Return the map as it was given, where what is marked in the live one costs much."""
    space = copy.copy(given)
    marked = (live.clearance < live.inscribed) & (given.clearance >= given.inscribed)
    space.slowness = given.zone_prices() * np.where(marked, np.float32(_PRICE), np.float32(1.0))
    return space


def until_closed(
    plan: Plan, given: PlanningMap, live: PlanningMap, moving: NDArray[np.float64]
) -> ClosedWay | None:
    """Return how far a path is free; None: all of it is.

    Parameters
    ----------
    plan
        The path over the map as it was given.
    given, live
        That map, and the same with all that the sensors have marked.
    moving
        (k, 5) what moves by itself, as `LocalSituation.moving`.
    """
    places = dense(plan.poses, 0.5 * live.grid.resolution_m)
    cells = live.poses_to_cells(places)
    marked = copy.copy(live)
    marked.blocked = live.blocked & ~given.blocked
    hits = marked.collides(cells)
    if not hits.any():
        return None
    first = int(np.argmax(hits))
    along_m = float(np.hypot(*np.diff(places[: first + 1, :2], axis=0).T).sum())
    text = _what_closes(SE2(*cells[first].tolist()), marked, moving)
    free_m = _out_of_doors(places[: first + 1], along_m - _STAND_OFF_M, live)
    return ClosedWay(_cut(plan, free_m) if free_m >= _SHORTEST_M else None, text)


def _out_of_doors(places: NDArray[np.float64], free_m: float, live: PlanningMap) -> float:
    """Return the way along places (n, 3) of `world` that ends in no door, at most so long [m]."""
    doors = live.closed.doors
    if not len(doors.places):
        return free_m
    ways_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places[:, :2], axis=0).T))])
    beside = doors.away_m(places[:, :2]) > RADIUS_M + live.footprint.reach_m
    return float(ways_m[beside & (ways_m <= free_m)].max(initial=0.0))


def _cut(plan: Plan, length_m: float) -> Plan:
    """Return the first part of a path."""
    ways = np.diff(plan.poses, axis=0)
    lengths_m = np.hypot(*ways[:, :2].T)
    ends_m = np.cumsum(lengths_m)
    piece = int(np.argmax(ends_m >= length_m))
    share = 1.0 - (ends_m[piece] - length_m) / lengths_m[piece]
    way = ways[piece]
    way[2] -= math.tau * np.round(way[2] / math.tau)
    poses = np.vstack([plan.poses[: piece + 1], plan.poses[piece] + share * way])
    return replace(plan, poses=poses, reverse=plan.reverse[: piece + 1])


def _what_closes(there: SE2, marked: PlanningMap, moving: NDArray[np.float64]) -> str:
    """Say what marked cells a body touches at a pose in cells, and where."""
    rows, columns = cells_at(moved(there, marked.samples), marked.shape)
    hit = marked.blocked[rows, columns]
    touched = np.stack([rows[hit], columns[hit]], axis=1)
    x_m, y_m = marked.grid.centre_of(touched).mean(axis=0).tolist()
    what = f"something {_size_m(marked.blocked, touched, marked.grid.resolution_m):.1f} m wide"
    if len(moving) and np.hypot(*(moving[:, :2] - (x_m, y_m)).T).min() <= _PERSON_RANGE_M:
        what = "somebody"
    return f"{what} that no map shows closes the way at x {x_m:.2f} m, y {y_m:.2f} m"


def _size_m(marked: NDArray[np.bool_], touched: NDArray[np.int64], side_m: float) -> float:
    """Return the longer side of what touched cells belong to, along the axes of the map [m]."""
    things, _ = ndimage.label(marked, _EIGHT)
    numbers = np.unique(things[tuple(touched.T)])
    rows, columns = np.nonzero(np.isin(things, numbers))
    return side_m * (1 + max(int(np.ptp(rows)), int(np.ptp(columns))))
