"""SLAM in the navigation process: the robot's place on a map that grows as it drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.app.localisation.localiser import (
    LocaliserBegin,
    LocaliserInput,
    MadeLocaliser,
    localisation_state,
    sensed_robot,
)
from robotctl.app.localisation.seen_images import SeenImages, rehearse
from robotctl.app.localisation.slam_files import KeyframeFile, keyframes_of, keyframes_to_localise
from robotctl.app.localisation.slam_graphs import SlamGraphs
from robotctl.app.localisation.slam_sensor import SlamSensor, recognises_places, slam_sensor
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.odometry.estimate import OdometryEstimate
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.sensor_names import SONAR
from robotctl.estimation.sensors.lidar import REHEARSED
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.heard_places import HeardPlaces
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.map_search import MapSearch
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap, SavedOdometry, as_saved
from robotctl.estimation.slam.keyframes.tracker import LEAST_ECHOES
from robotctl.estimation.slam.verdict.watch import VerdictWatch
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import ClosedLoop, LiveMap, LocalisationState, SlamGraph
from robotctl.messages.map_message import map_message
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarReading

_AT_ONCE: Final = 40
"""Keyframes that are drawn in one step when the map is redrawn."""


class SlamLocaliser:
    """Feeds a `SlamMapper` with scans; its `map` lies in `world` where it starts.

    Parameters
    ----------
    mapper
        Without a scan yet.
    sensor
        What the scans are made of.
    start
        `base` in `world` at the start.
    history
        Of the odometry; kept up to date by the caller.
    saved
        A map to go on with, in place of a start; the robot is expected where it was last on it.
    file
        Keeps the map; None: it is not kept.
    by_images
        Whether it recognises places by images of a camera, too.
    """

    def __init__(
        self,
        mapper: SlamMapper,
        sensor: SlamSensor,
        start: SE2,
        history: OdometryHistory,
        saved: KeyframeMap | None = None,
        file: KeyframeFile | None = None,
        *,
        by_images: bool = False,
    ) -> None:
        self.mapper = mapper
        self.config = sensor.robot.settings.slam
        self._sensor, self._maker = sensor, sensor.maker()
        self._history = history
        self._file = file
        self.T_world_map = start
        if saved is not None:
            mapper.resume(saved, is_there=True)
            self.T_world_map = saved.frame
            start = saved.frame @ mapper.pose
        self._watch = None if mapper.config.stretch_m else VerdictWatch(mapper)
        self._images = SeenImages(mapper) if by_images else None
        mounts, allowed = sensor.robot.mounts, sensor.robot.settings.sensors
        self._heard: HeardPlaces | None = None
        if mounts and SONAR in allowed:
            self._heard = HeardPlaces(mounts, mapper.loops)
        self._links = len(mapper.back_end.links)
        """Number of links of the graph that have been reported."""
        self._born_ns: list[int | None] = [None] * len(mapper.keyframes)
        """When `base` was where each keyframe is, in this run; one may get another scan later."""
        self._begun = self._pose = start
        """Pose in `world` where the odometry began, and now."""
        self.odometry = None if saved is None else saved.odometry
        """Odometry at the present pose, or when the map was saved; None: not known for sure."""
        self._doubted = -1
        """Number of keyframes when the odometry changed."""
        self._T_world_odom: SE2 | None = None
        self._last: SE2 | None = None
        """Odometry at the last scan that was taken."""
        at_start = PoseEstimate(0, start, self._covariance(start), LocalisationStatus.LOCALISED)
        self._reckoned = OdometryEstimate(sensor.robot.odometry, at_start)
        """Pose since the last scan, whose covariance grows with the way."""
        self._notices: list[str] = []
        self._taken_ns = 0
        """Time of that."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """No particles: (0, 3)."""
        return np.empty((0, 3))

    def begin_odometry(self) -> None:
        """Keep the map; the next control state's odometry is another one."""
        self.mapper.begin_odometry()
        self._maker = self._sensor.maker()
        if self._heard is not None:
            self._heard.begin_odometry()
        self._begun = self._pose
        self._T_world_odom = self._last = None

    def take_notices(self) -> list[str]:
        """Return which loops were closed since the last call."""
        notices, self._notices = self._notices, []
        return notices if self._file is None else notices + self._file.take_notices()

    def close(self) -> None:
        """Have the whole map saved."""
        if self._file is not None:
            self._file.close()

    def step(self, control: ControlState, seen: LocaliserInput, now_ns: int) -> LocalisationState:
        """Take the scans since the last step; return the present estimate."""
        self._perceive(seen)
        if self.mapper.relocalise() and self._last is not None:
            self._stand(self._last)
        if self._T_world_odom is None:
            self._T_world_odom = self._go_on(control)
            self._reckon_from(self._T_world_odom @ control.T_odom_base, control.T_odom_base)
        # A stretch is driven by odometry before the first scan is made of it.
        has_begun = bool(self.mapper.keyframes) or self.mapper.config.stretch_m > 0.0
        is_placed = has_begun and not self.mapper.is_lost
        status = LocalisationStatus.LOCALISED if is_placed else LocalisationStatus.SEARCHING
        odometry = control.T_odom_base
        self._pose = self._T_world_odom @ odometry
        self.odometry = None
        if len(self.mapper.keyframes) > self._doubted:
            row = as_saved(odometry)
            self.odometry = SavedOdometry(control.odom_epoch_ns, control.stamp_ns, row)
        if self._file is not None:
            self._file.step(self.mapper, self, now_ns)
        covariance = self._reckoned.follow(odometry, control.stamp_ns).covariance
        estimate = PoseEstimate(control.stamp_ns, self._pose, covariance, status)
        state = localisation_state("slam", estimate, odometry, now_ns)
        return msgspec.structs.replace(
            state,
            loops=self._closed_loops(),
            verdict="" if self._watch is None else self._watch.said,
        )

    def _go_on(self, control: ControlState) -> SE2:
        """Return where an odometry begins, in `world`: where the robot was when it was known last.

        It may be the one of then, of a control process that lived on.
        """
        then, mapper = self.odometry, self.mapper
        is_another = (
            then is None
            or then.epoch_ns != control.odom_epoch_ns
            or then.stamp_ns > control.stamp_ns
        )
        before = control.T_odom_base if then is None or is_another else SE2(*then.pose)
        T_world_odom = self._begun @ before.inverse()
        if mapper.keyframes and mapper.config.stretch_m:
            number, pose = self._on_map(T_world_odom @ control.T_odom_base)
            place = ScanPose(control.stamp_ns, number, pose)
            self._doubted = len(mapper.keyframes) if is_another else -1
            mapper.restart_segment(place, control.T_odom_base, is_another=is_another)
        return T_world_odom

    @property
    def place(self) -> tuple[int, SE2]:
        """The robot's keyframe, and `base` in it."""
        return self._on_map(self._pose)

    def _on_map(self, pose: SE2) -> tuple[int, SE2]:
        """Return the last keyframe, and a pose in `world` in it."""
        number = self.mapper.place.keyframe
        T_world_keyframe = self.T_world_map @ self.mapper.back_end.pose(number)
        return number, T_world_keyframe.inverse() @ pose

    def _perceive(self, seen: LocaliserInput) -> None:
        """Take what was seen since the last step."""
        mapper = self.mapper
        if seen.is_paused and mapper.config.stretch_m:
            return  # a stretch is no place to be localised at: odometry has to do
        mapper.is_paused = seen.is_paused
        if self._images is not None and not seen.is_paused:
            self._images.add(seen.images)
        if not seen.is_paused:
            self._hear(seen.measured.get(SONAR, ()))
        for measured in seen.measured.get(self._sensor.name, ()):
            odometry = self._history.at(measured.stamp_ns)
            for each in () if odometry is None else self._maker.add(measured, odometry):
                if self._is_new(each.scan, each.odometry):
                    self._take(each.scan, each.odometry)
        if self._images is not None and not seen.is_paused:
            self._images.show_new()

    def _hear(self, readings: Sequence[SonarReading]) -> None:
        """Take readings of the sonars, which know places where the robot turns on the spot."""
        if self._heard is None:
            return
        for reading in readings:
            odometry = self._history.at(reading.stamp_ns)
            if odometry is not None:
                self._heard.hear(reading, odometry)

    def _closed_loops(self) -> tuple[ClosedLoop, ...]:
        """Return the links of this run, since the last call, to places seen before."""
        mapper, born_ns = self.mapper, self._born_ns
        born_ns += [each.stamp_ns for each in mapper.keyframes[len(born_ns) :]]
        links = mapper.back_end.links[self._links :]
        self._links += len(links)
        return tuple(
            ClosedLoop(later, earlier, each.pose.x_m, each.pose.y_m, each.pose.theta_rad)
            for each in links
            if each.is_loop
            and (earlier := born_ns[each.first]) is not None
            and (later := born_ns[each.second]) is not None
        )

    def _is_new(self, scan: RangeScan, odometry: SE2) -> bool:
        """Return whether a scan says more than the last one."""
        config, rested_s = self.config, 1e-9 * (scan.stamp_ns - self._taken_ns)
        if self._last is None or self.mapper.is_lost or rested_s > config.rest_s:
            return True
        motion = self._last.inverse() @ odometry
        return (
            math.hypot(motion.x_m, motion.y_m) >= config.update_min_m
            or abs(wrap_angle(motion.theta_rad)) >= config.update_min_rad
        )

    def _take(self, scan: RangeScan, odometry: SE2) -> None:
        """Match a scan."""
        if not self.mapper.keyframes and len(scan.points_base()) < 2 * LEAST_ECHOES:
            return
        if not self.mapper.keyframes:
            # What was driven before the first scan is known by odometry alone.
            before = self._T_world_odom
            self.T_world_map = self._begun if before is None else before @ odometry
        epoch = self.mapper.epoch
        self.mapper.add(scan, odometry)
        if self._heard is not None and not self.mapper.is_paused:
            self._heard.look(self.mapper.place, odometry)
        self._last, self._taken_ns = odometry, scan.stamp_ns
        self._stand(odometry)
        if self._watch is not None:
            self._notices += self._watch.add(odometry)
        if self.mapper.epoch > epoch:
            self._notices.append(f"loop closed: {self.mapper.epoch} so far, the map is corrected")

    def _stand(self, odometry: SE2) -> None:
        """Be where the mapper has the robot, with `base` in `odom` then."""
        pose = self.T_world_map @ self.mapper.pose
        self._T_world_odom = pose @ odometry.inverse()
        self._reckon_from(pose, odometry)

    def _reckon_from(self, pose: SE2, odometry: SE2) -> None:
        """Be as sure as the mapper is at a pose in `world`, and go on by odometry from there."""
        self._reckoned.follow(odometry, 0)
        covariance = self._covariance(pose)
        self._reckoned.reset(PoseEstimate(0, pose, covariance, LocalisationStatus.LOCALISED))

    def _covariance(self, pose: SE2) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of the pose at the last scan, in `world`."""
        turn = np.eye(3)
        turn[:2, :2] = rotation(pose.theta_rad)
        result: NDArray[np.float64] = turn.T @ self.mapper.covariance @ turn
        return result


class _Picture:
    """A grid, and where which keyframes are in it."""

    def __init__(self, grid: OccupancyGrid, renewals: int) -> None:
        self.grid = grid
        self.renewals = renewals
        """How many keyframes had got a new scan when it was begun."""
        self.drawn = np.empty((0, 3))
        """Poses of keyframes in it; nan: not in it yet."""

    def missing(self, keyframes: Sequence[Keyframe]) -> NDArray[np.int64]:
        """Return the keyframes that are not in it, in the order in which they were seen."""
        more = np.full((len(keyframes) - len(self.drawn), 3), np.nan)
        self.drawn = np.concatenate([self.drawn, more])
        missing = np.flatnonzero(np.isnan(self.drawn[:, 0]))
        seen_m = np.array([keyframes[each].travelled_m for each in missing.tolist()])
        result: NDArray[np.int64] = missing[np.argsort(seen_m, kind="stable")]
        return result


class SlamDrawing:
    """The occupancy grid of a `SlamLocaliser`: its keyframes, drawn where they are now.

    After a closure, and where a keyframe got a new scan, all are drawn anew, some in each step, and
    shown when that is done; what was seen last comes last and prevails.
    """

    def __init__(self, localiser: SlamLocaliser, grid: OccupancyGrid) -> None:
        self._localiser = localiser
        self._picture = _Picture(grid, 0)
        self._next: _Picture | None = None
        self._redraw_ns = round(1e9 * localiser.config.redraw_every_s)
        self._begun_ns = -self._redraw_ns
        self._graphs = SlamGraphs()

    @property
    def grid(self) -> OccupancyGrid:
        """The map."""
        return self._picture.grid

    def step(self, localisation: LocalisationState | None, _seen: LocaliserInput) -> None:
        """Draw keyframes that are new, or some of those that have moved."""
        mapper, now_ns = self._localiser.mapper, localisation.stamp_ns if localisation else 0
        if self._next is None and self._is_old() and now_ns - self._begun_ns >= self._redraw_ns:
            self._begun_ns = now_ns
            self._next = _Picture(OccupancyGrid(self.grid.config), mapper.known_places.renewals)
        self._draw(self._picture)
        if self._next is not None and self._draw(self._next):
            self._picture, self._next = self._next, None

    def _is_old(self) -> bool:
        """Return whether keyframes are elsewhere by now, or have another scan."""
        mapper, drawn = self._localiser.mapper, self._picture.drawn
        off = np.hypot(*(mapper.back_end.poses[: len(drawn), :2] - drawn[:, :2]).T)
        has_moved = bool(
            np.nan_to_num(off).max(initial=0.0) > self._localiser.config.redraw_shift_m
        )
        return has_moved or mapper.known_places.renewals != self._picture.renewals

    def _draw(self, picture: _Picture) -> bool:
        """Draw some keyframes that are not in a picture; return whether it is complete."""
        mapper, T_world_map = self._localiser.mapper, self._localiser.T_world_map
        missing = picture.missing(mapper.keyframes)
        new = missing[:_AT_ONCE]
        if len(new):
            poses = mapper.back_end.poses[new]
            placed = np.column_stack(
                [moved(T_world_map, poses[:, :2]), poses[:, 2] + T_world_map.theta_rad]
            )
            picture.grid.update_scans(
                placed, [mapper.keyframes[each].scan for each in new.tolist()]
            )
            picture.drawn[new] = poses
        return len(missing) == len(new)

    def settled_map(self) -> GridMap | None:
        """Return the map, if all keyframes are drawn where they are now."""
        drawn = len(self._picture.missing(self._localiser.mapper.keyframes)) == 0
        return self.grid.to_map() if drawn and not self._is_old() else None

    def pictures(self, now_ns: int) -> list[LiveMap | SlamGraph]:
        """Return the map if anything has been seen, and the graph if it is due."""
        pictures: list[LiveMap | SlamGraph] = []
        if len(self._picture.drawn):
            pictures.append(map_message(self.grid.to_map(), now_ns))
        localiser = self._localiser
        graph = self._graphs.due(localiser.mapper.back_end, localiser.T_world_map, now_ns)
        return pictures if graph is None else [*pictures, graph]


def make(begin: LocaliserBegin) -> MadeLocaliser:
    """Return the mapper of a robot that knows no map or goes on with its own, and what draws it.

    Raises
    ------
    ConfigError, DiskError
        If the robot has no sensor for it, or the map that it localises itself in cannot be read;
        if it cannot be kept.
    """
    config, grid = begin.config, begin.config.localisation.grid
    sensor = slam_sensor(config, sensed_robot(config))
    places = keyframes_of(config.localisation, begin.beside, begin.state)
    quick = SlamMapper(KeyframeConfig(keyframe_m=0.0))
    rehearsed = SlamLocaliser(quick, sensor, SE2(), OdometryHistory())
    _rehearse(rehearsed)
    by_images = recognises_places(config)
    if by_images:
        rehearse(quick)
    drawing = SlamDrawing(rehearsed, OccupancyGrid(grid))
    drawing.step(None, LocaliserInput())
    drawing.pictures(0)
    saved, file = None, None
    if places.path is not None and places.is_read_only:
        saved = keyframes_to_localise(places.path, sensor.name)
    elif places.path is not None:
        file = KeyframeFile(places.path, sensor.name, is_own=places.is_own)
        saved = file.saved
    mapper = SlamMapper(replace(sensor.config, is_live=True, is_fixed=places.is_read_only))
    localiser = SlamLocaliser(
        mapper, sensor, begin.start, begin.history, saved, file, by_images=by_images
    )
    drawn = SlamDrawing(localiser, OccupancyGrid(grid))
    return MadeLocaliser(localiser, drawing=drawn, close=localiser.close)


def _rehearse(localiser: SlamLocaliser) -> None:
    """Have all kernels compiled."""
    mapper = localiser.mapper
    for _ in range(mapper.config.linked_keyframes + 2):
        mapper.add(REHEARSED, SE2())
    search = MapSearch(mapper.growing, mapper.keyframes[0])
    while not search.step():
        pass
