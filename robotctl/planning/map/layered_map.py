"""The map that the robot plans on: what it was given, with what its sensors see now.

The map that the robot localises itself in stays for ever. Lidar, sonars and camera each mark and
clear cells in a layer of their own: a lidar that looks over a box does not clear what the camera
sees of it. What is not seen again is forgotten. Points that the map explains are not marked, so
that a small error of the pose does not make walls thicker.

It is right while the pose is: after a jump, `forget`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED, OCCUPIED_FROM, UNKNOWN, GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.map import marks
from robotctl.planning.map.body_cells import cells_at, drawn_in
from robotctl.planning.map.clearance import Clearance
from robotctl.planning.map.config import MapConfig
from robotctl.planning.map.discs import Disc, cells_around
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.shut_cells import ShutCells
from robotctl.planning.map.take_over import take_over, take_values
from robotctl.planning.map.zones import Closed, path_prices, speed_limits

_BEYOND_M: Final = 1.0
"""Clearance is known up to this beyond the circle in which the robot turns [m]: more than any
planner's margin and comfort."""
_FLOOR_REACH_M: Final = 1.5
"""`FloorMemory` has all points within this of the robot [m]."""
_PERSON_M: Final = 0.35
"""Maximum distance of a person's marks from the middle of that person [m]."""
_ROUNDING: Final = 1e-9
"""Part of a cell that is rounding of a corner."""

NOTHING_MOVES: Final = np.empty((0, 5))


class LayeredMap:
    """The live map.

    Parameters
    ----------
    grid
        The map that the robot localises itself in; everything beyond it is blocked.
    footprint
        Of the robot.
    config
        See there.
    closed
        Parts of it that the robot keeps out of or passes slowly, and its fence.
    full_speed_m_s
        Of the robot where no zone limits it [m/s], > 0.
    through_unknown
        Whether the robot may pass where neither map nor sensors know anything.

    Attributes
    ----------
    shut
        The parts that the robot keeps out of.
    """

    def __init__(
        self,
        grid: GridMap,
        footprint: Footprint,
        config: MapConfig = MapConfig(),  # noqa: B008
        closed: Closed = Closed(),  # noqa: B008
        full_speed_m_s: float = 1.0,
        *,
        through_unknown: bool = False,
    ) -> None:
        self.config = config
        self._grid = grid
        self._through_unknown = through_unknown
        self._closed, self._full_speed_m_s = closed, full_speed_m_s
        self._given = grid.cells.copy()
        static = grid.occupied(OCCUPIED_FROM)
        shut = closed.cells(grid)
        self._given[shut] = OCCUPIED
        live = GridMap(self._given.copy(), grid.resolution_m, grid.origin)
        self._space = space = PlanningMap(
            live,
            footprint,
            through_unknown=through_unknown,
            occupied_percent=OCCUPIED_FROM,
        )
        space.closed = closed
        self._inner = drawn_in(footprint, space.samples, grid.resolution_m)
        self._limits_m_s = speed_limits(grid, closed, full_speed_m_s)
        space.slowness = path_prices(grid, closed, self._limits_m_s, full_speed_m_s)
        reach = math.ceil((footprint.reach_m + _BEYOND_M) / grid.resolution_m) + 1
        self._clearance = Clearance(space.blocked, space.clearance, reach)
        self._cells = marks.Cells(
            self._given.copy(),
            live.cells,
            space.obstacle,
            space.blocked,
            np.zeros(grid.shape, np.uint8),
            _distances(static),
            self._clearance.stale,
            reach,
            OCCUPIED_FROM,
            through_unknown,
        )
        self.shut = ShutCells(closed, shut, grid.cells[shut], space, self._cells)
        self._lidar = marks.make_layer(grid.shape, 1, gain=3, needed=1, most=3)
        # One echo of a sonar in seven has nothing to do with the world: two must agree.
        self._sonar = marks.make_layer(grid.shape, 2, gain=2, needed=3, most=6)
        self._floor = marks.make_layer(grid.shape, 4, gain=1, needed=1, most=1)
        self._layers = self._lidar, self._sonar, self._floor
        self._warm_up()

    @classmethod
    def without_map(
        cls,
        low: tuple[float, float],
        high: tuple[float, float],
        resolution_m: float,
        footprint: Footprint,
        closed: Closed = Closed(),  # noqa: B008
        full_speed_m_s: float = 1.0,
        config: MapConfig = MapConfig(),  # noqa: B008
    ) -> LayeredMap:
        """Return a map of which nothing is known, and that the robot may pass until it sees more.

        What is not seen again stays longer: nothing else tells of walls behind the robot.

        Parameters
        ----------
        low, high
            Its corners in `world` [m], moved to whole cells from there; beyond, everything is
            blocked.
        """
        first = [math.floor(low[i] / resolution_m + _ROUNDING) for i in (1, 0)]
        last = [math.ceil(high[i] / resolution_m - _ROUNDING) for i in (1, 0)]
        cells = np.full((last[0] - first[0], last[1] - first[1]), UNKNOWN, np.int8)
        origin = SE2(first[1] * resolution_m, first[0] * resolution_m, 0.0)
        grid = GridMap(cells, resolution_m, origin)
        config = replace(config, decay_s=config.unmapped_decay_s)
        return cls(grid, footprint, config, closed, full_speed_m_s, through_unknown=True)

    def grown(self, points_world: NDArray[np.float64]) -> LayeredMap:
        """Return a map `without_map` that holds some points (n, 2) [m], too, and knows the same."""
        grid = self._space.grid
        rows, columns = grid.shape
        first = np.array([grid.origin.x_m, grid.origin.y_m])
        last = first + np.array([columns, rows]) * grid.resolution_m
        corners = np.vstack([points_world, first, last])
        low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        larger = LayeredMap.without_map(
            (low[0], low[1]),
            (high[0], high[1]),
            grid.resolution_m,
            self._space.footprint,
            self._closed,
            self._full_speed_m_s,
            self.config,
        )
        at = larger._space.grid.cell_of(grid.centre_of(np.zeros((1, 2), np.int64)))[0].tolist()
        take_over(larger._cells, larger._layers, self._cells, self._layers, at)
        return larger

    def with_body(self, footprint: Footprint) -> LayeredMap:
        """Return the same map for another body, with what was seen."""
        other = self._begun(footprint)
        take_over(other._cells, other._layers, self._cells, self._layers, [0, 0])
        return other

    def unseen(self) -> PlanningMap:
        """Return the whole map as it was before anything was seen."""
        return self._begun(self._space.footprint).space()

    def _begun(self, footprint: Footprint) -> LayeredMap:
        """Return the same map for a body, with nothing seen."""
        return LayeredMap(
            self._grid,
            footprint,
            self.config,
            self._closed,
            self._full_speed_m_s,
            through_unknown=self._through_unknown,
        )

    def recall(self, grid: GridMap, now_ns: int) -> None:
        """Take what another map of the same place knows, which was seen by lidar until a time [ns].

        It replaces what the lidar has seen, where that map is.
        """
        rows, columns = np.divmod(np.arange(self._cells.live.size), self._space.shape[1])
        there = grid.cell_of(self._space.grid.centre_of(np.column_stack([rows, columns])))
        inside = np.all((there >= 0) & (there < grid.shape), axis=1)
        values = np.full(self._space.shape, UNKNOWN, np.int8)
        values.ravel()[inside] = grid.cells[tuple(there[inside].T)]
        take_values(self._cells, self._lidar, values, now_ns)

    def room_m(self, pose: SE2) -> float:
        """Return how far a pose of `world` is from the map's edge [m]; < 0: off the map."""
        here = self._space.to_cells(pose)
        rows, columns = self._space.shape
        room = min(here.x_m, here.y_m, columns - here.x_m, rows - here.y_m)
        return room * self._space.grid.resolution_m

    def forget(self) -> None:
        """Forget all that was seen: the pose was wrong, and so are the places."""
        cells = self._cells
        for layer in self._layers:
            layer.evidence[:] = 0
            layer.in_list[0] = 0
        cells.marks[:] = 0
        self.shut.forget()
        cells.base[:] = cells.live[:] = self._given
        cells.obstacle[:] = cells.base >= OCCUPIED_FROM
        if not self._through_unknown:
            cells.blocked[:] = cells.obstacle | (cells.base < 0)
        cells.stale[:] = True

    def forget_unseen(self, before_ns: int) -> None:
        """Forget marks that no sensor has seen since a time [ns]; what was seen free stays so."""
        for layer in self._layers:
            marks.fade(self._cells, layer, before_ns)

    def see_scan(
        self,
        T_world_base: SE2,
        scan: RangeScan,
        now_ns: int,
        moving: NDArray[np.float64] = NOTHING_MOVES,
    ) -> None:
        """Take a lidar's scan.

        Parameters
        ----------
        T_world_base
            The robot's pose when it was taken.
        scan
            Its beams in their order; without an echo (inf) they are free up to its range.
        now_ns
            Time of the scan [ns].
        moving
            (k, 5) what moves by itself, as `LocalSituation.moving`: it leaves no marks.
        """
        side_m = self._space.grid.resolution_m
        sensor = self._space.to_cells(T_world_base @ SE2(scan.x_m, scan.y_m, 0.0))
        angles = scan.angles_rad + sensor.theta_rad
        away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        config = self.config
        lengths = np.minimum(scan.ranges_m, min(scan.max_range_m, config.lidar_range_m)) / side_m
        echo = (scan.ranges_m < scan.max_range_m) & (scan.ranges_m <= config.lidar_range_m)
        reach = np.where(echo, lengths, np.nan)
        points = (sensor.x_m, sensor.y_m) + reach[:, np.newaxis] * away
        agree = (config.agree_m + config.agree_per_m * scan.ranges_m) / side_m
        discs = np.empty((len(moving), 3))
        for i, (x_m, y_m, _, _, radius_m) in enumerate(moving.tolist()):
            centre = self._space.to_cells(SE2(x_m, y_m, 0.0))
            discs[i] = centre.x_m, centre.y_m, (radius_m + config.moving_margin_m) / side_m
        self._fade(self._lidar, now_ns)
        for x, y, radius in discs.tolist():
            marks.empty_disc(self._cells, self._lidar, x, y, radius)
        gap = 2.0 * self._space.inscribed
        marks.mark_points(self._cells, self._lidar, points, agree, discs, gap, now_ns)
        # The last cell before an echo is as good as it.
        free = np.where(echo, lengths - 1.0, lengths)
        marks.clear_beams(self._cells, self._lidar, sensor.x_m, sensor.y_m, away, free, now_ns)

    def see_echoes(
        self,
        T_world_base: SE2,
        mounts: Sequence[SonarMount],
        ranges_m: Sequence[float],
        now_ns: int,
        moves: Sequence[bool] = (),
    ) -> list[bool]:
        """Take new readings of sonars; return which are of what has stood there for a second.

        That is what the map explains or what was marked so long ago. No echo, or one from too far
        away to be marked, counts as well.

        An echo came from somewhere on an arc as wide as the cone. Two that agree mark the arc if
        neither the map nor another sensor has something there, and only where it is no wider than
        the robot; nearer echoes and free cones correct it later.

        Parameters
        ----------
        ranges_m
            One for each mount [m]: inf without echo, nan if there is no new one.
        moves
            Whether each is of something that moves, which only shows what is free before it; empty:
            none is.
        """
        self._fade(self._sonar, now_ns)
        side_m = self._space.grid.resolution_m
        config = self.config
        half_width = 0.5 * math.radians(config.sonar_beam_deg)
        widest_m = self._space.footprint.inscribed_m / math.sin(half_width)
        stands = []
        moving = moves or (False,) * len(mounts)
        for mount, range_m, is_moving in zip(mounts, ranges_m, moving, strict=True):
            if math.isnan(range_m):
                stands.append(True)
                continue
            sensor = self._space.to_cells(
                T_world_base @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
            )
            free_m = range_m - 2.0 * config.sonar_band_m
            if range_m == math.inf:
                free_m = config.no_echo_m
            echo_m = range_m if range_m <= widest_m and not is_moving else math.nan
            stood = marks.see_cone(
                self._cells,
                self._sonar,
                sensor.x_m,
                sensor.y_m,
                sensor.theta_rad,
                half_width,
                max(min(free_m, config.sonar_free_m), 0.0) / side_m,
                echo_m / side_m,
                config.sonar_band_m / side_m,
                (config.agree_m + config.agree_per_m * echo_m) / side_m,
                now_ns,
                now_ns - round(1e9 * config.stood_s),
            )
            stands.append(bool(stood))
        return stands

    def see_floor(
        self, T_world_base: SE2, points_base: Sequence[tuple[float, float]], now_ns: int
    ) -> None:
        """Take all points around the robot that the camera remembers, `FloorMemory.around`."""
        self._fade(self._floor, now_ns)
        side_m = self._space.grid.resolution_m
        points = np.empty((len(points_base), 2))
        for i, (x_m, y_m) in enumerate(points_base):
            point = self._space.to_cells(T_world_base @ SE2(x_m, y_m, 0.0))
            points[i] = point.x_m, point.y_m
        agree = np.full(len(points), self.config.agree_m / side_m)
        marks.mark_points(self._cells, self._floor, points, agree, np.empty((0, 3)), 0.0, now_ns)
        robot = self._space.to_cells(T_world_base)
        marks.empty_unseen(
            self._cells, self._floor, robot.x_m, robot.y_m, _FLOOR_REACH_M / side_m, now_ns
        )

    def explained(self, points_world: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (n, 2) [m] the map itself explains, (n,): they are near its walls."""
        cells = self._space.grid.cell_of(points_world)
        inside = np.all((cells >= 0) & (cells < self._space.shape), axis=1)
        result = np.zeros(len(cells), np.bool_)
        near = self._cells.from_static[tuple(cells[inside].T)]
        result[inside] = near * self._space.grid.resolution_m <= 2.0 * self.config.agree_m
        return result

    def space(self) -> PlanningMap:
        """Return a copy of the whole map for a global planner."""
        rows, columns = self._space.shape
        self._clearance.refresh((0, 0), (rows - 1, columns - 1))
        return self._space.window((0, 0), (rows - 1, columns - 1))

    def space_around(self, pose: SE2, radius_m: float) -> PlanningMap:
        """Return a copy of the map around a pose of `world`: a square of twice the radius [m]."""
        here = self._space.to_cells(pose)
        size = math.ceil(radius_m / self._space.grid.resolution_m)
        first, last = [], []
        for place, cells in zip((here.y_m, here.x_m), self._space.shape, strict=True):
            cell = min(max(math.floor(place), 0), cells - 1)
            first.append(max(cell - size, 0))
            last.append(min(cell + size, cells - 1))
        self._clearance.refresh((first[0], first[1]), (last[0], last[1]))
        return self._space.window((first[0], first[1]), (last[0], last[1]))

    def collides(self, poses_world: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return at which poses of `base` in `world` (n, 3) the body is in a blocked cell, (n,).

        It asks the live map, without the copy that `space` takes.
        """
        poses = self._space.poses_to_cells(poses_world)
        if len(poses):
            around = self._clearance.reach
            rows, columns = self._space.shape
            low, high = poses.min(axis=0) - around, poses.max(axis=0) + around
            first = [min(max(math.floor(low[i]), 0), n - 1) for i, n in ((1, rows), (0, columns))]
            last = [min(max(math.floor(high[i]), 0), n - 1) for i, n in ((1, rows), (0, columns))]
            self._clearance.refresh((first[0], first[1]), (last[0], last[1]))
        return self._space.collides(poses)

    def stand_at(self, T_world_base: SE2) -> None:
        """Note that the floor under the robot is free, whatever echoes from its own edge say."""
        here = self._space.to_cells(T_world_base)
        marks.learn_free(self._cells, moved(here, self._space.samples))
        rows, columns = cells_at(moved(here, self._inner), self._space.shape)
        wrong = np.argwhere(self._cells.marks[rows, columns])[:, 0]
        for row, column in zip(rows[wrong].tolist(), columns[wrong].tolist(), strict=True):
            for layer in self._layers:
                marks.empty_disc(self._cells, layer, column + 0.5, row + 0.5, 0.5)

    def is_known(self, poses_world: NDArray[np.float64]) -> bool:
        """Return whether all under the body at poses (n, 3) of `base` in `world` is known."""
        for pose in self._space.poses_to_cells(poses_world).tolist():
            under = moved(SE2(*pose), self._space.samples)
            rows, columns = cells_at(under, self._space.shape)
            if len(rows) < len(under) or (self._cells.live[rows, columns] < 0).any():
                return False
        return True

    def speed_limits_at(self, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the lowest limits of the slow zones at points (n, 2) [m/s]; inf: none."""
        limits = np.full(len(points_world), math.inf)
        if self._limits_m_s is not None:
            cells = self._space.grid.cell_of(points_world)
            on_map = np.all((cells >= 0) & (cells < self._space.shape), axis=1)
            limits[on_map] = self._limits_m_s[tuple(cells[on_map].T)]
        return limits

    def marked(self) -> NDArray[np.bool_]:
        """Return which cells sensors have marked, (rows, columns)."""
        return self._cells.marks > 0

    def is_marked_near(self, x_m: float, y_m: float) -> bool:
        """Return whether sensors have marked something within reach of a person at a place [m]."""
        here = self._space.to_cells(SE2(x_m, y_m, 0.0))
        person = Disc(here.x_m, here.y_m, _PERSON_M / self._space.grid.resolution_m)
        return bool(self._cells.marks[cells_around(person)].any())

    def marked_world(self) -> NDArray[np.float64]:
        """Return the centres of the cells that sensors have marked, (n, 2) [m]."""
        return self._space.grid.centre_of(np.argwhere(self._cells.marks))

    def _fade(self, layer: marks.Layer, now_ns: int) -> None:
        """Forget what a layer has not seen again."""
        marks.fade(self._cells, layer, now_ns - round(1e9 * self.config.decay_s))

    def _warm_up(self) -> None:
        """Compile all."""
        scan = RangeScan(0, np.zeros(2), np.array([1.0, math.inf]), 2.0)
        far = self._space.grid.origin @ SE2(-100.0, -100.0, 0.0)
        self.see_scan(far, scan, 0, np.zeros((1, 5)))
        self.see_echoes(far, [SonarMount("warm", 0.0, 0.0, 0.0)], [0.1], 0)
        self.see_floor(far, [(0.0, 0.0)], 0)
        self.stand_at(far)
        self.forget()


def _distances(obstacle: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return how far each cell is from an obstacle, from centre to centre [cells]; inf: none."""
    if not obstacle.any():
        return np.full(obstacle.shape, np.inf, np.float32)
    distances: NDArray[np.float32] = ndimage.distance_transform_edt(~obstacle).astype(np.float32)
    return distances
