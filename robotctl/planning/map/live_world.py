"""Live model of the world around the robot: given map, marks of sensors, moving obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.merging import ScanMerger
from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.map.config import MapConfig
from robotctl.planning.map.doors import Doors
from robotctl.planning.map.heard import heard_walkers
from robotctl.planning.map.layered_map import NOTHING_MOVES, LayeredMap
from robotctl.planning.map.planning_map import PlanningMap, clearance_of
from robotctl.planning.map.seen import Seen
from robotctl.planning.map.sight import seen_along
from robotctl.planning.map.standing import StandingPeople
from robotctl.planning.map.tracks import MovingObstacles
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed


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
    closed
        Zones and masks of the robot's file.
    config
        See there.
    full_speed_m_s, braking_m_s2
        Its speed where no zone limits that [m/s], and how it brakes before one that does [m/s^2].
    lidars
        Number of its lidars, without whose scans it stands.

    Attributes
    ----------
    body
        The present outline of the robot.
    moving
        (k, 5) what moves by itself, as `LocalSituation.moving`.
    heard
        (k, 5) who is heard to come along the robot's line, by one that has no lidar.
    last_scan
        The last scan of the lidars, as one view, with `base` in `world` at its time; None: there is
        none yet.
    standing
        People who walked and have stopped.
    map
        The live map.
    """

    def __init__(
        self,
        footprint: Footprint,
        mounts: tuple[SonarMount, ...],
        grid: GridMap | None,
        home: SE2,
        closed: Closed,
        config: MapConfig = MapConfig(),  # noqa: B008
        *,
        full_speed_m_s: float,
        braking_m_s2: float,
        lidars: int,
    ) -> None:
        self.body = footprint
        self._mounts = mounts
        self._grid = grid
        self._config = config
        self._own_zones = closed.zones
        self._closed = closed
        self._full_speed_m_s = full_speed_m_s
        self._braking_m_s2 = braking_m_s2
        self._lidars = lidars
        self.moving = self.heard = NOTHING_MOVES
        self.last_scan: tuple[SE2, RangeScan] | None = None
        self._new_echoes = [0] * len(mounts)
        self._merger = ScanMerger()
        self._tracks = {"": MovingObstacles(config.tracks)}
        self.standing = StandingPeople()
        self._scan_ns: dict[str, int] = {}
        """Time of the last scan of each lidar, by its name [ns]."""
        self._now_ns = 0
        self._here = home
        self._begin()
        self._once_marked = self.map.marked()
        """Cells that were marked on this journey, (rows, columns); with a map."""

    def _begin(self) -> None:
        """Begin a map in which nothing has been seen."""
        self.map = self._given_of = self._begun()
        self._given = self.map.space()

    @property
    def given(self) -> PlanningMap:
        """The live map as it was before anything was seen."""
        if self._given_of is not self.map:  # it has grown, or the body has changed
            self._given_of, self._given = self.map, self.map.unseen()
        return self._given

    def _begun(self) -> LayeredMap:
        """Return a map in which nothing has been seen."""
        if self._grid is not None:
            return LayeredMap(
                self._grid, self.body, self._config, self._closed, self._full_speed_m_s
            )
        low, high = _beside(self._here, self._config.around_m).tolist()
        return LayeredMap.without_map(
            (low[0], low[1]),
            (high[0], high[1]),
            self._config.cell_m,
            self.body,
            self._closed,
            self._full_speed_m_s,
            self._config,
        )

    # Seeing

    def see(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take in what was seen; `pose` is that of `base` in `world` now."""
        self._here, self._now_ns = pose, now_ns
        if self._grid is None and self.map.room_m(pose) < self._config.lidar_range_m:
            self.map = self.map.grown(_beside(pose, self._config.around_m))
        self.map.shut.close_behind(pose)
        self.map.stand_at(pose)
        for T_odom_base, scan in seen.scans:
            if scan.stamp_ns > self._scan_ns.get(scan.name, -1):
                self._scan_ns[scan.name] = scan.stamp_ns
                self._take(seen.T_world_odom, T_odom_base, scan)
        self.heard = NOTHING_MOVES
        if not self.sees_by_lidar:
            self._hear(pose, seen, now_ns)
        self.map.see_floor(pose, seen.floor_base, now_ns)

    def _take(self, T_world_odom: SE2, T_odom_base: SE2, scan: RangeScan) -> None:
        """Take a scan: moving things are tracked, the rest is marked in the map."""
        where = T_world_odom @ T_odom_base
        view = self._merger.add(scan, T_odom_base)
        self.last_scan = self.last_scan if view is None else (where, view)
        angles = where.theta_rad + scan.angles_rad
        sensor = where @ SE2(scan.x_m, scan.y_m, 0.0)
        ranges = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, 0.0)[:, np.newaxis]
        ends = (sensor.x_m, sensor.y_m) + ranges * np.stack([np.cos(angles), np.sin(angles)], 1)
        if scan.name not in self._tracks:
            self._tracks[scan.name] = MovingObstacles(self._config.tracks)
        self._tracks[scan.name].step(T_odom_base, scan, scan.stamp_ns, ~self.map.explained(ends))
        self.moving = np.concatenate([each.moving(T_world_odom) for each in self._tracks.values()])
        self.map.see_scan(where, scan, scan.stamp_ns, self.moving)
        self.standing.see(self.moving, self.map.is_marked_near, scan.stamp_ns)

    def _hear(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take echoes of sonars."""
        approaches = seen.approaches or ((math.inf, 0.0),) * len(seen.ranges_m)
        moves = [closing_m_s != 0.0 for _, closing_m_s in approaches]
        stand = self.map.see_echoes(pose, self._mounts, seen.ranges_m, now_ns, moves)
        heard = zip(seen.ranges_m, stand, moves, strict=True)
        for i, (range_m, stands, is_moving) in enumerate(heard):
            if not (math.isnan(range_m) or is_moving):
                self._new_echoes[i] = 0 if stands else self._new_echoes[i] + 1
        if any(moves):
            self.heard = heard_walkers(pose, self._mounts, approaches, self.map.explained)

    @property
    def sees_by_lidar(self) -> bool:
        """Whether there is a lidar, in the robot's file or heard by now."""
        return self._lidars > 0 or bool(self._scan_ns)

    @property
    def has_map(self) -> bool:
        """Whether it was given a map."""
        return self._grid is not None

    @property
    def doors(self) -> Doors:
        """Doors of its map that cost something."""
        return self._closed.doors

    @property
    def knows_ways(self) -> bool:
        """Whether it has a map, or a lidar that shows the way; else only sonars."""
        return self.has_map or self.sees_by_lidar

    @property
    def blindness(self) -> str:
        """Why the robot must not drive on what it sees; empty if it may."""
        if not self.sees_by_lidar:
            return ""
        silent = len(self._scan_ns) < self._lidars
        last_ns = -1 if silent else min(self._scan_ns.values())
        is_blind = self._now_ns - last_ns > round(1e9 * self._config.blind_s)
        return "the lidar gives no scans" if is_blind else ""

    @property
    def may_move(self) -> tuple[bool, ...]:
        """Whether the last echoes of each sonar are of something that was not there before."""
        return tuple(count >= self._config.new_echoes for count in self._new_echoes)

    def is_somebody_near(self, pose: SE2) -> bool:
        """Return whether something that moves, or may move, is near a pose."""
        away_m = np.hypot(self.moving[:, 0] - pose.x_m, self.moving[:, 1] - pose.y_m)
        return any(self.may_move) or bool((away_m < self._config.person_range_m).any())

    # Changing

    def use_body(self, footprint: Footprint) -> None:
        """Ask for another body from now on; what was seen stays known."""
        self.body = footprint
        self.map = self.map.with_body(footprint)

    # Forgetting

    def use_zones(self, zones: Sequence[Zone]) -> None:
        """Take zones beside those of the file; what was seen is forgotten where they differ."""
        self._close(self._closed._replace(zones=(*self._own_zones, *zones)))

    def use_fence(self, fence: Fence) -> None:
        """Take another fence; what was seen is forgotten where it differs."""
        self._close(self._closed._replace(fence=fence))

    def _close(self, closed: Closed) -> None:
        """Take other bounds of where the robot may be."""
        if closed == self._closed:
            return
        self._closed = closed
        self._begin()
        self.forget()

    def forget(self) -> None:
        """Forget what was seen: the robot's pose in `world` has jumped."""
        self.map.forget()
        self._once_marked[:] = False
        for tracks in self._tracks.values():
            tracks.reset()
        self._merger = ScanMerger()
        self.last_scan = None
        self.moving = self.heard = NOTHING_MOVES
        self.standing.forget()

    def forget_unseen(self) -> None:
        """Forget obstacles that no sensor has seen lately."""
        self.map.forget_unseen(self._now_ns - round(1e9 * self._config.recent_s))

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
        return self.map.space_around(pose, self._config.view_m)

    def touches(self, poses: NDArray[np.float64]) -> bool:
        """Return whether the body touches something at one of the poses (n, 3) of `world`."""
        return bool(len(poses)) and bool(self.map.collides(poses).any())

    def holds(self, goal: SE2) -> bool:
        """Return whether a goal is on the map, or no map can be made that has it."""
        return self.has_map or self.map.room_m(SE2(goal.x_m, goal.y_m, 0.0)) > 0.0

    def grow_to(self, place: SE2) -> None:
        """Make the map so large that a place has room around it."""
        self.map = self.map.grown(_beside(place, self._config.around_m))

    def speed_limit(self, pose: SE2, path: NDArray[np.float64]) -> float:
        """Return the speed that keeps the limits of slow zones [m/s], here and as the robot brakes.

        `path` is what lies ahead, places (n, 3) of `world`; inf: no zone limits it.
        """
        places = np.vstack([(pose.x_m, pose.y_m), path[:, :2]])
        away_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
        limits_m_s = self.map.speed_limits_at(places)
        return float(np.sqrt(limits_m_s**2 + 2.0 * self._braking_m_s2 * away_m).min())

    def sight_m(self, path: NDArray[np.float64]) -> float:
        """Return the way on a path to what no lidar sees [m]; inf: there is none, or no lidar."""
        if self.last_scan is None:
            return math.inf
        body = self.body
        half_m = max(body.left_m, body.right_m)
        return seen_along(*self.last_scan, path, half_m, body.reach_m)


def _beside(pose: SE2, around_m: float) -> NDArray[np.float64]:
    """Return the corners of the square around a pose that has to be on the map, (2, 2) [m]."""
    return np.array([(pose.x_m + away, pose.y_m + away) for away in (-around_m, around_m)])
