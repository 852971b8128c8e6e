"""Live model of the world around the robot: given map, marks of sensors, moving obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.map.layered_map import FARTHEST_M, NOTHING_MOVES, LayeredMap
from robotctl.planning.map.layers_config import LayersConfig
from robotctl.planning.map.planning_map import PlanningMap, clearance_of
from robotctl.planning.map.seen import Seen
from robotctl.planning.map.tracks import MovingObstacles
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed

_BLIND_NS: Final = 500_000_000
"""Maximum age of the last scan with which a robot that has a lidar drives [ns]."""
_AGREE: Final = 2
"""Echoes in a row that show something new: one alone may have nothing to do with the world."""
_PERSON_RANGE_M: Final = 2.0
"""Maximum distance of a person who counts as near [m]."""
_RECENT_NS: Final = 1_000_000_000
"""Age up to which an obstacle counts as still seen [ns]."""
_LOOK_M: Final = 4.0
"""Half of the side of the map that the local controller gets [m]."""
_CELL_M: Final = 0.05
"""Cell of a map that the robot makes itself [m]."""
_AROUND_M: Final = 20.0
"""Margin of such a map around goals, and around the robot whenever it comes near the edge [m]."""


class LiveWorld:
    """Keeps a live map, the tracks of what moves, and the bounds of where the robot may be.

    Parameters
    ----------
    footprint, mounts
        Of the robot; the sonars in the order of the ranges.
    grid
        The map that the robot localises itself in; None: it has none, and may pass where it has
        seen nothing.
    home
        Where it starts.
    zones
        Of the robot's file.
    full_speed_m_s, braking_m_s2
        Its speed where no zone limits that [m/s], and how it brakes before one that does [m/s^2].
    has_lidar
        Whether it has one, without whose scans it stands.

    Attributes
    ----------
    moving
        (k, 5) what moves by itself, as `LocalSituation.moving`.
    last_scan
        The last scan of the lidar with `base` in `world` at its time; None: there is none yet.
    map
        The live map.
    given
        The map as given, with nothing seen yet.
    """

    def __init__(
        self,
        footprint: Footprint,
        mounts: tuple[SonarMount, ...],
        grid: GridMap | None,
        home: SE2,
        zones: Sequence[Zone],
        *,
        full_speed_m_s: float,
        braking_m_s2: float,
        has_lidar: bool,
    ) -> None:
        self._footprint = footprint
        self._mounts = mounts
        self._grid = grid
        self._own_zones = tuple(zones)
        self._closed = Closed(self._own_zones)
        self._full_speed_m_s = full_speed_m_s
        self._braking_m_s2 = braking_m_s2
        self._has_lidar = has_lidar
        self.moving = NOTHING_MOVES
        self.last_scan: tuple[SE2, RangeScan] | None = None
        self._new_echoes = [0] * len(mounts)
        self._tracks = MovingObstacles()
        self._scan_ns = -1
        self._now_ns = 0
        self._here = home
        self.map = self._begun()
        self.given = self.map.space()
        self._once_marked = self.map.marked()
        """Cells that were marked on this journey, (rows, columns); with a map."""

    def _begun(self) -> LayeredMap:
        """Return a map in which nothing has been seen."""
        if self._grid is not None:
            return LayeredMap(
                self._grid, self._footprint, LayersConfig(), self._closed, self._full_speed_m_s
            )
        low, high = _beside(self._here).tolist()
        return LayeredMap.without_map(
            (low[0], low[1]),
            (high[0], high[1]),
            _CELL_M,
            self._footprint,
            self._closed,
            self._full_speed_m_s,
        )

    # Seeing

    def see(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take in what was seen; `pose` is that of `base` in `world` now."""
        self._here, self._now_ns = pose, now_ns
        if self._grid is None and self.map.room_m(pose) < FARTHEST_M:
            self.map = self.map.grown(_beside(pose))
        self.map.shut.close_behind(pose)
        self.map.stand_at(pose)
        for T_odom_base, scan in seen.scans:
            if scan.stamp_ns > self._scan_ns:
                self._scan_ns = scan.stamp_ns
                self._take(seen.T_world_odom, T_odom_base, scan)
        if not self._sees_by_lidar:
            self._hear(pose, seen.ranges_m, now_ns)
        self.map.see_floor(pose, seen.floor_base, now_ns)

    def _take(self, T_world_odom: SE2, T_odom_base: SE2, scan: RangeScan) -> None:
        """Take a scan: moving things are tracked, the rest is marked in the map."""
        where = T_world_odom @ T_odom_base
        self.last_scan = where, scan
        angles = where.theta_rad + scan.angles_rad
        sensor = where @ SE2(scan.x_m, scan.y_m, 0.0)
        ranges = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, 0.0)[:, np.newaxis]
        ends = (sensor.x_m, sensor.y_m) + ranges * np.stack([np.cos(angles), np.sin(angles)], 1)
        self._tracks.step(T_odom_base, scan, scan.stamp_ns, ~self.map.explained(ends))
        self.moving = self._tracks.moving(T_world_odom)
        self.map.see_scan(where, scan, scan.stamp_ns, self.moving)

    def _hear(self, pose: SE2, ranges_m: Sequence[float], now_ns: int) -> None:
        """Take echoes of sonars."""
        stand = self.map.see_echoes(pose, self._mounts, ranges_m, now_ns)
        for i, (range_m, stands) in enumerate(zip(ranges_m, stand, strict=True)):
            if not math.isnan(range_m):
                self._new_echoes[i] = 0 if stands else self._new_echoes[i] + 1

    @property
    def _sees_by_lidar(self) -> bool:
        """Whether there is a lidar, in the robot's file or heard by now."""
        return self._has_lidar or self._scan_ns >= 0

    @property
    def has_map(self) -> bool:
        """Whether it was given a map."""
        return self._grid is not None

    @property
    def knows_ways(self) -> bool:
        """Whether it has a map, or a lidar that shows the way; else only sonars."""
        return self.has_map or self._sees_by_lidar

    @property
    def blindness(self) -> str:
        """Why the robot must not drive on what it sees; empty if it may."""
        if self._sees_by_lidar and self._now_ns - self._scan_ns > _BLIND_NS:
            return "the lidar gives no scans"
        return ""

    @property
    def may_move(self) -> tuple[bool, ...]:
        """Whether the last two echoes of each sonar are of something that was not there before."""
        return tuple(count >= _AGREE for count in self._new_echoes)

    def is_somebody_near(self, pose: SE2) -> bool:
        """Return whether something that moves, or may move, is near a pose."""
        away_m = np.hypot(self.moving[:, 0] - pose.x_m, self.moving[:, 1] - pose.y_m)
        return any(self.may_move) or bool((away_m < _PERSON_RANGE_M).any())

    # Forgetting

    def use_zones(self, zones: Sequence[Zone]) -> None:
        """Take zones beside those of the file; what was seen is forgotten where they differ."""
        self._close(Closed((*self._own_zones, *zones), self._closed.fence))

    def use_fence(self, fence: Fence) -> None:
        """Take another fence; what was seen is forgotten where it differs."""
        self._close(Closed(self._closed.zones, fence))

    def _close(self, closed: Closed) -> None:
        """Take other bounds of where the robot may be."""
        if closed == self._closed:
            return
        self._closed = closed
        self.map = self._begun()
        self.given = self.map.space()
        self.forget()

    def forget(self) -> None:
        """Forget what was seen: the robot's pose in `world` has jumped."""
        self.map.forget()
        self._once_marked[:] = False
        self._tracks.reset()
        self.last_scan = None
        self.moving = NOTHING_MOVES

    def forget_unseen(self) -> None:
        """Forget obstacles that no sensor has seen lately."""
        self.map.forget_unseen(self._now_ns - _RECENT_NS)

    def recall(self, grid: GridMap) -> None:
        """Know what a map knows that the robot has made, in place of what was seen so far."""
        self.forget()
        if self._grid is None:
            rows, columns = grid.shape
            corners = grid.centre_of(np.array([[0, 0], [0, columns], [rows, 0], [rows, columns]]))
            self.map = self.map.grown(corners)
            self.map.recall(grid, self._now_ns)

    def begin_journey(self) -> None:
        """Count from now on what `forgotten` is asked about."""
        self._once_marked[:] = False

    def note_marks(self) -> None:
        """Remember for `forgotten` what is marked now."""
        if self.has_map:
            self._once_marked |= self.map.marked()

    def forgotten(self) -> PlanningMap | None:
        """Return what was marked on this journey and is no more; None: nothing, or no map."""
        if not self.has_map:
            return None
        live = self.map.space()
        cells = self._once_marked & ~live.blocked
        if not cells.any():
            return None
        live.blocked, live.clearance = cells, clearance_of(cells)
        return live

    # Asking

    def space_around(self, pose: SE2) -> PlanningMap:
        """Return what the local controller looks at."""
        return self.map.space_around(pose, _LOOK_M)

    def touches(self, poses: NDArray[np.float64]) -> bool:
        """Return whether the body touches something at one of the poses (n, 3) of `world`."""
        return bool(len(poses)) and bool(self.map.collides(poses).any())

    def holds(self, goal: SE2) -> bool:
        """Return whether a goal is on the map, or no map can be made that has it."""
        return self.has_map or self.map.room_m(SE2(goal.x_m, goal.y_m, 0.0)) > 0.0

    def grow_to(self, place: SE2) -> None:
        """Make the map so large that a place has room around it."""
        self.map = self.map.grown(_beside(place))

    def speed_limit(self, pose: SE2, path: NDArray[np.float64]) -> float:
        """Return the speed that keeps the limits of slow zones [m/s], here and as the robot brakes.

        `path` is what lies ahead, places (n, 3) of `world`; inf: no zone limits it.
        """
        places = np.vstack([(pose.x_m, pose.y_m), path[:, :2]])
        away_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
        limits_m_s = self.map.speed_limits_at(places)
        return float(np.sqrt(limits_m_s**2 + 2.0 * self._braking_m_s2 * away_m).min())


def _beside(pose: SE2) -> NDArray[np.float64]:
    """Return the corners of a square around a pose, (2, 2) [m]."""
    return np.array([(pose.x_m + away_m, pose.y_m + away_m) for away_m in (-_AROUND_M, _AROUND_M)])
