"""Worlds made by hand: what a lidar sees in rooms and corridors, and how to get about there.

Neither is of the code under test: beams are marched over rectangles, ways are searched breadth
first on cells.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.topological.build import build
from robotctl.planning.map.topological.graph import TopologicalMap

Box = tuple[float, float, float, float]
"""Of x and y: low, low, high, high [m]."""
SIDE_M = 0.1
REACH_M = 12.0
ROOMS = {
    "hall": (0.2, 0.2, 6.2, 4.2),
    "study": (6.4, 0.2, 10.4, 3.2),
    "store": (6.4, 3.4, 9.4, 8.4),
    "den": (0.2, 4.4, 6.2, 7.4),
}
DOORS = {
    ("hall", "study"): (6.2, 1.2, 6.4, 2.1),
    ("study", "store"): (7.7, 3.2, 8.6, 3.4),
    ("den", "store"): (6.2, 5.2, 6.4, 6.1),
    ("hall", "den"): (2.2, 4.2, 3.1, 4.4),
}
CORRIDORS = {
    "west": (0.2, 3.0, 5.5, 4.6),
    "crossing": (5.5, 3.0, 7.1, 4.6),
    "east": (7.1, 3.0, 10.6, 4.6),
    "north": (5.5, 4.6, 7.1, 8.8),
    "office": (0.2, 0.2, 4.2, 2.8),
    "lab": (7.3, 5.2, 10.6, 8.8),
}
CORRIDOR_DOORS = {
    ("west", "office"): (1.5, 2.8, 2.4, 3.0),
    ("north", "lab"): (7.1, 7.2, 7.3, 8.1),
}
CUPBOARDS = (
    (0.2, 3.4, 1.4, 4.2),
    (9.6, 2.4, 10.4, 3.2),
    (6.4, 7.6, 7.4, 8.4),
    (0.2, 6.6, 1.0, 7.4),
)

_NOTHING = TopologicalMap((), ())


@dataclass(frozen=True)
class LittleWorld:
    """Rooms with doors; `closed` doors are walls, `boxes` stand about that are not on the map.

    `map` has no coordinates.
    """

    map: TopologicalMap
    rooms: Mapping[str, Box] = field(default_factory=lambda: ROOMS)
    doors: Mapping[tuple[str, str], Box] = field(default_factory=lambda: DOORS)
    cupboards: tuple[Box, ...] = CUPBOARDS
    closed: tuple[tuple[str, str], ...] = ()
    boxes: tuple[Box, ...] = ()

    def is_free(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points are floor."""
        doors = [box for ends, box in self.doors.items() if ends not in self.closed]
        free = _inside([*self.rooms.values(), *doors], x, y)
        return free & ~_inside([*self.cupboards, *self.boxes], x, y)

    def room_at(self, x_m: float, y_m: float) -> str:
        """Return the room of a point, empty in a doorway."""
        for name, box in self.rooms.items():
            if _inside([box], np.array(x_m), np.array(y_m)):
                return name
        return ""

    def scan(self, pose: SE2, stamp_ns: int) -> RangeScan:
        """Return what a lidar sees from a pose."""
        angles = np.linspace(-math.pi, math.pi, 180, endpoint=False)
        ranges = np.arange(0.05, REACH_M, 0.03)
        headings = pose.theta_rad + angles[:, None]
        blocked = ~self.is_free(
            pose.x_m + ranges * np.cos(headings), pose.y_m + ranges * np.sin(headings)
        )
        return RangeScan(stamp_ns, angles, ranges[blocked.argmax(axis=1)], REACH_M)

    def way(self, start: SE2, goal: tuple[float, float]) -> list[tuple[float, float]]:
        """Return the cells on a way that keeps off the walls; none: there is none."""
        rows, columns = np.mgrid[0:90, 0:108]
        x, y = (columns + 0.5) * SIDE_M, (rows + 0.5) * SIDE_M
        free = np.ones(x.shape, np.bool_)
        for off_x, off_y in ((0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25)):
            free &= self.is_free(x + off_x, y + off_y)
        begin = int(start.y_m / SIDE_M), int(start.x_m / SIDE_M)
        end = int(goal[1] / SIDE_M), int(goal[0] / SIDE_M)
        before = {begin: begin}
        waiting = deque([begin])
        while waiting and end not in before:
            row, column = waiting.popleft()
            for beside in (
                (row + 1, column),
                (row - 1, column),
                (row, column + 1),
                (row, column - 1),
            ):
                if beside not in before and free[beside]:
                    before[beside] = row, column
                    waiting.append(beside)
        path: list[tuple[float, float]] = []
        while end in before and end != begin:
            path.append((float(x[end]), float(y[end])))
            end = before[end]
        return path[::-1]


@cache
def little_world() -> LittleWorld:
    """Return the rooms in a ring, places named, all coordinates left out."""
    return _mapped(LittleWorld(_NOTHING))


@cache
def corridors() -> LittleWorld:
    """Return a corridor with another one that branches off it, and a room at each."""
    cupboards = (0.2, 3.0, 0.7, 3.9), (9.7, 4.2, 10.6, 4.6), (0.2, 0.2, 1.0, 1.4)
    return _mapped(LittleWorld(_NOTHING, CORRIDORS, CORRIDOR_DOORS, cupboards))


def _mapped(world: LittleWorld) -> LittleWorld:
    rows, columns = np.mgrid[0:90, 0:108]
    free = world.is_free((columns + 0.5) * SIDE_M, (rows + 0.5) * SIDE_M)
    grid = GridMap(np.where(free, FREE, OCCUPIED).astype(np.int8), SIDE_M)
    topology = build(grid, 0.2).map
    for place in topology.places:
        topology = topology.renamed(place.name, world.room_at(place.x_m, place.y_m))
    unknown = {"x_m": math.nan, "y_m": math.nan}
    bare = TopologicalMap(
        tuple(replace(each, **unknown) for each in topology.places),
        tuple(replace(each, **unknown) for each in topology.passages),
    )
    return replace(world, map=bare)


def _inside(boxes: object, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    found = np.zeros(np.shape(x), np.bool_)
    for low_x, low_y, high_x, high_y in boxes:  # type: ignore[attr-defined]
        found |= (x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y)
    return found
