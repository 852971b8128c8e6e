"""Part of a world that a robot could map, against which its map is scored.

A piece of a wall, or of another thing that stands there, counts if the sensor has a line of sight
to it, within its range, from a spot that the robot can reach. So the backs of things and the
insides of walls do not count, nor what lies behind a door that is too narrow; a room that the robot
could have entered and did not does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.sensors.rays import cast_fan, fan_angles
from firmware_sim.world.cells import Cells
from firmware_sim.world.world import World
from robotctl.app.scoring.score import MapQuality
from robotctl.config.robot_file import RobotConfig
from robotctl.estimation.sensor_names import LIDAR
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

PIECE_M: Final = 0.05
"""Walls are cut into pieces no longer than this."""
SPACING_M: Final = 0.2
"""Spacing of spots from which the robot looks, except in worlds of more than `_MOST_SPOTS`."""
_MOST_SPOTS: Final = 10_000
_SIDE_M: Final = 0.05
"""Side of the cells in which it moves [m]."""
_RAYS: Final = 720
_TILE_M: Final = 2.0
"""Spots in one tile see the same sides at most."""


class MapTruth:
    """The walls of a world, and those that can be mapped.

    Parameters
    ----------
    walls
        Sides of all that stands there.
    visible
        Finds those that can be seen, once there is a map.
    """

    def __init__(self, walls: WallMap, visible: Callable[[], WallMap]) -> None:
        self._walls = walls
        self._find = visible

    @cached_property
    def _visible(self) -> WallMap:
        return self._find()

    def quality(self, grid: GridMap) -> MapQuality:
        """Return how good a map is: as it lies in `world`, and laid over the walls."""
        # scipy takes a while to load.
        from robotctl.estimation.grid.map_quality import laid_over, map_quality  # noqa: PLC0415

        there = map_quality(grid, self._walls, self._visible)
        aligned = map_quality(laid_over(grid, self._walls), self._walls, self._visible)
        return MapQuality(
            precision=there.precision,
            recall=there.recall,
            aligned_precision=aligned.precision,
            aligned_recall=aligned.recall,
        )


def map_truth(simulated: SimulatedRobot, room: World, start: SE2, robot: RobotConfig) -> MapTruth:
    """Return what the map of a run is scored against.

    The sensor is the lidar, if the robot has one and localises by it, else its sonars.
    """
    lidars = simulated.simulation.lidars if LIDAR in robot.localisation.sensors else ()
    sensor = max(lidars, key=lambda each: each.max_range_m, default=simulated.simulation.sonar)
    radius_m = robot.footprint.inscribed_m
    seen = room.seen_from(sensor.z_m).segments
    return MapTruth(
        WallMap(room.touchable),
        lambda: visible_walls(
            seen, reachable(room.touchable, start, radius_m, room.cells), sensor.max_range_m
        ),
    )


def reachable(
    sides: NDArray[np.float64], start: SE2, radius_m: float, cells: Cells | None = None
) -> NDArray[np.float64]:
    """Return spots that a round robot gets to, `SPACING_M` apart, and its start, (n, 2) [m].

    Parameters
    ----------
    sides
        Of all that it must not touch, (m, 4): x, y, x, y [m].
    start
        Where it is.
    radius_m
        Its own [m].
    cells
        Of a world that is a map: it keeps to those that are free.
    """
    from scipy import ndimage  # type: ignore[import-untyped] # noqa: PLC0415 - it takes 0.2 s

    from robotctl.estimation.grid.wall_raster import grid_of_walls  # noqa: PLC0415

    grid = grid_of_walls(WallMap(sides), _SIDE_M)
    room_m = ndimage.distance_transform_edt(~grid.occupied()) * _SIDE_M
    floor = ~grid.occupied() & (room_m >= radius_m)
    if cells is not None:
        floor[floor] = cells.is_free(grid.centre_of(np.argwhere(floor)))
    here = np.array([[start.x_m, start.y_m]])
    spots = np.argwhere(floor)
    if len(spots) == 0:
        return here
    nearest = spots[np.argmin(np.hypot(*(grid.centre_of(spots) - here).T))]
    floors, _ = ndimage.label(floor)
    floor = floors == floors[tuple(nearest)]
    spacing_m = max(SPACING_M, _SIDE_M * math.sqrt(np.count_nonzero(floor) / _MOST_SPOTS))
    step = round(spacing_m / _SIDE_M)
    return np.vstack([here, grid.centre_of(np.argwhere(floor[::step, ::step]) * step)])


def visible_walls(
    sides: NDArray[np.float64], spots: NDArray[np.float64], reach_m: float
) -> WallMap:
    """Return the pieces of sides that are seen from some spot; all sides if none is.

    Parameters
    ----------
    sides
        Of all that is high enough to be seen, (n, 4): x, y, x, y [m].
    spots
        (k, 2) [m].
    reach_m
        Range of the sensor [m].
    """
    begins, along = sides[:, :2], sides[:, 2:] - sides[:, :2]
    pieces = np.ceil(np.hypot(*along.T) / PIECE_M).astype(np.int64)
    firsts = np.cumsum(pieces) - pieces
    changes = np.zeros(int(pieces.sum()) + 1, np.int64)
    for x_m, y_m, numbers in _with_sides(spots, sides, reach_m):
        hits, share = _look(x_m, y_m, np.ascontiguousarray(sides[numbers]), reach_m)
        side = numbers[hits]
        piece = firsts[side] + np.minimum(share * pieces[side], pieces[side] - 1).astype(np.int64)
        # From beam to beam on one side all is seen.
        other = np.where(hits == np.roll(hits, 1), np.roll(piece, 1), piece)
        np.add.at(changes, np.minimum(piece, other)[hits >= 0], 1)
        np.add.at(changes, np.maximum(piece, other)[hits >= 0] + 1, -1)
    is_seen = np.cumsum(changes)[:-1] > 0
    if not is_seen.any():
        return WallMap(sides)
    side = np.repeat(np.arange(len(sides)), pieces)
    step = along[side] / pieces[side, None]
    start = begins[side] + (np.arange(len(side)) - firsts[side])[:, None] * step
    return WallMap(np.hstack([start, start + step])[is_seen])


def _with_sides(
    spots: NDArray[np.float64], all_sides: NDArray[np.float64], reach_m: float
) -> Iterator[tuple[float, float, NDArray[np.int64]]]:
    """Yield x and y of spots, with the numbers of all sides that may be in reach."""
    begins, along = all_sides[:, :2], all_sides[:, 2:] - all_sides[:, :2]
    square = np.maximum(np.sum(along**2, axis=1), 1e-12)
    tiles, tile_of = np.unique(np.floor(spots / _TILE_M), axis=0, return_inverse=True)
    for number, tile in enumerate(tiles):
        offset = (tile + 0.5) * _TILE_M - begins
        share = np.clip(np.sum(offset * along, axis=1) / square, 0.0, 1.0)
        apart_m = np.hypot(*(offset - share[:, None] * along).T)
        sides = np.flatnonzero(apart_m <= reach_m + _TILE_M)
        if len(sides) > 0:
            for x_m, y_m in spots[tile_of.ravel() == number].tolist():
                yield x_m, y_m, sides


def _look(
    x_m: float, y_m: float, sides: NDArray[np.float64], reach_m: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return for each ray from a spot the side it meets, -1 for none, and where, 0 to 1."""
    angles = fan_angles(_RAYS, math.tau)
    ranges, hits = np.empty(_RAYS), np.empty(_RAYS, np.int32)
    cast_fan(x_m, y_m, 0.0, angles, reach_m, sides, ranges, hits)
    ranges[hits < 0] = 0.0
    offset = np.column_stack([x_m + ranges * np.cos(angles), y_m + ranges * np.sin(angles)])
    begins, along = sides[hits, :2], sides[hits, 2:] - sides[hits, :2]
    share = np.sum((offset - begins) * along, axis=1) / np.sum(along**2, axis=1)
    return hits, np.clip(share, 0.0, 1.0)
