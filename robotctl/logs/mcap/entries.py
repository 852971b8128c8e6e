"""Logged content of the published messages: topics, schemas, and entries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Final, TypeAlias

import msgspec

from robotctl.logs.mcap.drawings import Drawn
from robotctl.logs.mcap.forms import (
    camera_content,
    camera_schema,
    control_content,
    control_schema,
    localisation_content,
    localisation_schema,
)
from robotctl.logs.mcap.foxglove import (
    FrameTransforms,
    Grid,
    LaserScan,
    Log,
    PointCloud,
    PoseInFrame,
    grid,
    laser_scan,
    log_line,
    place_cloud,
    point_cloud,
)
from robotctl.logs.mcap.scene import Scene
from robotctl.logs.mcap.scene_update import SceneUpdate
from robotctl.logs.mcap.schema import JsonSchema, plain, schema_of
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.messages.estimation import (
    CameraView,
    GivenMap,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
    SlamGraph,
)

Published: TypeAlias = (
    ControlState
    | NavigationState
    | LocalisationState
    | LidarScan
    | CameraView
    | Notice
    | ParticleCloud
    | PlanView
    | LiveMap
    | GivenMap
    | SlamGraph
)
"""The logged entry."""

Entry: TypeAlias = tuple[str, int, Callable[[], object]]
"""Topic, wall time [ns], and maker of the content, called only if the topic is wanted."""

MAP_NS: Final = 5_000_000_000
"""Period of logging a growing map [ns]; encoding a large one is expensive."""

FRAMES_NS: Final = 30_000_000
"""Period of frame entries [ns], every second state of the control process."""

CLOUD_NS: Final = {"arc": 500_000_000, "obstacles": 1_000_000_000}
"""Periods of clouds that compress badly [ns]."""


def _ready(content: object) -> Callable[[], object]:
    """Return the maker of ready content."""
    return lambda: content


def _drawn(wall_ns: int, drawings: Iterable[Drawn]) -> Iterator[Entry]:
    """Yield drawings as entries."""
    for topic, drawing in drawings:
        yield topic, wall_ns, _ready(drawing)


def _well_known(kind: type[msgspec.Struct]) -> tuple[str, JsonSchema]:
    """Return name and schema of messages known to viewers."""
    return f"foxglove.{kind.__name__}", schema_of(kind, complete=True)


# Topics are numbered in this order, by which damaged logs are read.
TOPICS: Final[dict[str, tuple[str, JsonSchema]]] = {
    "control": ("ControlState", control_schema()),
    "navigation": ("NavigationState", schema_of(NavigationState)),
    "localisation": ("LocalisationState", localisation_schema()),
    "camera": ("CameraView", camera_schema()),
    "lidar": _well_known(LaserScan),
    "notice": _well_known(Log),
    "frames": _well_known(FrameTransforms),
    "sensor_frames": _well_known(FrameTransforms),
    "T_world_base": _well_known(PoseInFrame),
    "map": _well_known(Grid),
    "live_map": _well_known(Grid),
    "particles": _well_known(PointCloud),
    "path": _well_known(PointCloud),
    "costs": _well_known(Grid),
    "arc": _well_known(PointCloud),
    "obstacles": _well_known(PointCloud),
    "moving": _well_known(SceneUpdate),
    "loops": _well_known(SceneUpdate),
    "seen": _well_known(SceneUpdate),
    "sonar_cones": _well_known(SceneUpdate),
    "outline": _well_known(SceneUpdate),
    "covariance": _well_known(SceneUpdate),
    "goal": _well_known(SceneUpdate),
    "slam_graph": _well_known(SceneUpdate),
}
"""Name and schema of the messages of each topic."""


class LogEntries:
    """Turns published messages into the entries of one file.

    Parameters
    ----------
    epoch_ns
        Added to the stamps of messages to get wall time [ns].
    name
        Name of the robot.
    scene
        Common data of all files of a run.
    """

    def __init__(self, epoch_ns: int, name: str, scene: Scene) -> None:
        self._epoch_ns = epoch_ns
        self._name = name
        self._scene = scene
        self._drawings = scene.drawings
        self._is_begun = False
        self._framed_ns = -FRAMES_NS
        self._clouds: dict[str, tuple[int, bytes]] = {}
        """Newest cloud of each topic in the file, and its time [ns]."""
        self._maps: dict[str, LiveMap] = {}
        """Maps in the file."""

    def of(self, message: Published) -> Iterator[Entry]:
        """Yield the entries of a message, after those for the whole file at the first one."""
        wall_ns = message.stamp_ns + self._epoch_ns
        if not self._is_begun:
            self._is_begun = True
            yield from self._sensor_frames(wall_ns)
            yield from self._known_maps(wall_ns)
            yield from _drawn(wall_ns, self._drawings.standing(wall_ns))
        yield from self._of(wall_ns, message)

    def _of(self, wall_ns: int, message: Published) -> Iterator[Entry]:
        """Yield the entries of a message."""
        match message:
            case ControlState():
                yield from self._of_control(wall_ns, message)
            case LidarScan():
                yield from self._of_scan(wall_ns, message)
            case LiveMap():
                yield from self._of_map("live_map", message)
            case GivenMap():
                yield from self._of_map("map", message.map)
            case LocalisationState():
                self._scene.localise(message)
                yield "localisation", wall_ns, partial(localisation_content, message)
                yield from _drawn(wall_ns, self._drawings.of_localisation(wall_ns, message))
            case NavigationState():
                yield "navigation", wall_ns, partial(plain, message)
                yield from _drawn(wall_ns, self._drawings.of_navigation(wall_ns, message))
            case CameraView():
                yield "camera", wall_ns, partial(camera_content, message)
                yield from _drawn(wall_ns, self._drawings.of_camera(wall_ns, message))
            case Notice():
                yield "notice", wall_ns, partial(log_line, wall_ns, message, self._name)
            case ParticleCloud() | PlanView() | SlamGraph():
                yield from self._of_picture(wall_ns, message)

    def _of_picture(
        self, wall_ns: int, message: ParticleCloud | PlanView | SlamGraph
    ) -> Iterator[Entry]:
        """Yield the entries of messages for display."""
        if isinstance(message, SlamGraph):
            yield from _drawn(wall_ns, self._drawings.of_graph(wall_ns, message))
            return
        if isinstance(message, ParticleCloud):
            yield "particles", wall_ns, partial(point_cloud, wall_ns, message.poses)
            return
        yield "path", wall_ns, partial(point_cloud, wall_ns, message.path)
        if self._is_time_for("arc", message.arc, message.stamp_ns):
            yield "arc", wall_ns, partial(point_cloud, wall_ns, message.arc)
        if self._is_time_for("obstacles", message.obstacles, message.stamp_ns):
            yield "obstacles", wall_ns, partial(place_cloud, wall_ns, message.obstacles)
        yield from _drawn(wall_ns, self._drawings.of_plan(wall_ns, message))
        yield from self._of_map("costs", message.costs)

    def _is_time_for(self, topic: str, cloud: bytes, stamp_ns: int) -> bool:
        """Return whether a cloud differs from the last one, and that is old enough."""
        before_ns, before = self._clouds.get(topic, (-CLOUD_NS[topic], None))
        if cloud == before or 0 <= stamp_ns - before_ns < CLOUD_NS[topic]:
            return False
        self._clouds[topic] = stamp_ns, cloud
        return True

    def newest_maps(self) -> Iterator[Entry]:
        """Yield the maps that changed since they were last logged, for the end of the file."""
        for topic, world_map in self._scene.maps.items():
            yield from self._changed_map(topic, world_map.stamp_ns + self._epoch_ns, world_map)

    def _of_control(self, wall_ns: int, state: ControlState) -> Iterator[Entry]:
        """Yield a state of the control process, and the robot's pose."""
        yield "control", wall_ns, partial(control_content, state, self._scene.sonar_names)
        yield from _drawn(wall_ns, self._drawings.of_control(wall_ns, state))
        if 0 <= state.stamp_ns - self._framed_ns < FRAMES_NS:
            return
        self._framed_ns = state.stamp_ns
        frames, pose = self._scene.frames(wall_ns, state)
        yield "frames", wall_ns, _ready(frames)
        if pose is not None:
            yield "T_world_base", wall_ns, _ready(pose)

    def _of_scan(self, wall_ns: int, message: LidarScan) -> Iterator[Entry]:
        """Yield a scan, unless invalid."""
        scan = laser_scan(wall_ns, message)
        if scan is None:
            return
        if self._scene.place_lidar(message):
            yield from self._sensor_frames(wall_ns)
        yield "lidar", wall_ns, _ready(scan)

    def _sensor_frames(self, wall_ns: int) -> Iterator[Entry]:
        """Yield the sensor mounting."""
        frames = self._scene.sensor_frames(wall_ns)
        if frames is not None:
            yield "sensor_frames", wall_ns, _ready(frames)

    def _known_maps(self, wall_ns: int) -> Iterator[Entry]:
        """Yield the maps of the previous file."""
        for topic, world_map in self._scene.maps.items():
            yield from self._changed_map(topic, wall_ns, world_map)

    def _of_map(self, topic: str, world_map: LiveMap) -> Iterator[Entry]:
        """Yield a map if due."""
        self._scene.maps[topic] = world_map
        before = self._maps.get(topic)
        if before is None or world_map.stamp_ns - before.stamp_ns >= MAP_NS:
            yield from self._changed_map(topic, world_map.stamp_ns + self._epoch_ns, world_map)

    def _changed_map(self, topic: str, wall_ns: int, world_map: LiveMap) -> Iterator[Entry]:
        """Yield a map unless the file already has it."""
        before = self._maps.get(topic)
        if (
            before is None
            or msgspec.structs.replace(before, stamp_ns=world_map.stamp_ns) != world_map
        ):
            self._maps[topic] = world_map
            yield topic, wall_ns, partial(grid, wall_ns, world_map)
