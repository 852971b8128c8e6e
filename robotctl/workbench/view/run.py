"""One run that is replayed: what the robot had published by any time of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

import robotctl
from robotctl.app.processes.web import outline_of
from robotctl.config.robot_file import RobotConfig, robot_of_json
from robotctl.errors import RobotctlError
from robotctl.logs.formats.robotctl_log import truth_files
from robotctl.logs.formats.tum import read_tum
from robotctl.logs.mcap import restored
from robotctl.logs.mcap.restored import Content
from robotctl.messages.estimation import GivenMap, LiveMap, PlanView
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.polygons import Polygon
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.flight.recorder import read_record
from robotctl.web.replay_wire import History, Series
from robotctl.web.wire import RobotOutline, SonarOutline
from robotctl.workbench.logs.rows import RecordingError
from robotctl.workbench.view.history import HistoryReader, Lost, known_ns, series_of
from robotctl.workbench.view.index import Logged, RunIndex
from robotctl.workbench.view.run_files import files_of

_SIMPLE: Final[Mapping[str, tuple[str, Callable[[int, Content], msgspec.Struct]]]] = {
    "LiveMap": ("live_map", restored.live_map),
    "NavigationState": ("navigation", restored.navigation_state),
    "LidarScan": ("lidar", restored.lidar_scan),
    "CameraView": ("camera", restored.camera_view),
    "ParticleCloud": ("particles", restored.particle_cloud),
    "ControlState": ("control", restored.control_state),
}
"""Topic of the log and its reader, by the message that it was."""

_OF_PLAN: Final = ("arc", "obstacles", "moving", "costs")
"""Topics beside `path` of a view of the plan; logs of older versions lack some."""
_POSE: Final = ("x", "y", "theta")
_NO_COSTS: Final = LiveMap(0, 0, 0, 1.0, 0.0, 0.0, b"")
_UNKNOWN_BODY: Final = ((0.2, -0.15), (0.2, 0.15), (-0.2, 0.15), (-0.2, -0.15))
_UNREADABLE: Final = (msgspec.DecodeError, LookupError, TypeError, ValueError)

_encode: Final = msgspec.msgpack.Encoder().encode


class Picture(NamedTuple):
    """Newest message of a kind at a time; `key` is that of no other."""

    name: str
    key: object
    make: Callable[[], Sequence[bytes]]


class ReplayedRun:
    """A recording that is open.

    Parameters
    ----------
    path
        Folder of `--record`, or one `robot-*.mcap`.
    stack
        Closes it.

    Raises
    ------
    RecordingError
        If it is no recording of a robot.
    OSError
        If it cannot be read.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.name = path.resolve().name
        self.notes: list[str] = []
        files = files_of(path, self.notes.append, stack)
        self._index = RunIndex(files, stack)
        if "control" not in self._index.topics:
            raise RecordingError(
                f"{path}: no message of the topic `control` in it, so it is no recording of "
                f"robotctl; there are {', '.join(sorted(self._index.topics)) or 'none in JSON'}"
            )
        self.begin_ns, self.end_ns = self._index.begin_ns, self._index.end_ns
        self._lost: list[Lost] = []
        self._made: dict[str, tuple[object, Sequence[bytes]]] = {}
        self._truth: Trajectory | None = None
        self._read_truth(files[0].name)
        self.outline = self._outline(files[0].name.parent)

    @property
    def length_ns(self) -> int:
        """Time from the first to the last message [ns]."""
        return self.end_ns - self.begin_ns

    def history(self) -> History:
        """Read the whole run once; for a thread of its own."""
        reader = HistoryReader(self._index, self.notes)
        history = reader.read()
        self._lost = reader.lost
        return history

    def series(self, names: Sequence[str]) -> list[Series]:
        """Return fields over the whole run, as `series_of`; for a thread of its own."""
        return series_of(self._index, names)

    def pictures(self, at_ns: int) -> Iterator[Picture]:
        """Yield the newest messages at a time since the beginning [ns], states last."""
        at_ns += self.begin_ns
        yield from self._given_map(at_ns)
        yield from self._localisation(at_ns)
        yield from self._plan(at_ns)
        yield from self._true(at_ns)
        for name, (topic, read) in _SIMPLE.items():
            logged = self._index.newest(topic, at_ns)
            if logged is not None:
                yield Picture(name, logged.log_ns, partial(self._read, logged, read))

    def made(self, picture: Picture) -> Sequence[bytes]:
        """Return the messages of a picture, made once as long as it is the newest.

        There are none if a version wrote them that logged something else.
        """
        known = self._made.get(picture.name)
        if known is None or known[0] != picture.key:
            try:
                known = picture.key, picture.make()
            except _UNREADABLE:
                known = picture.key, ()
            self._made[picture.name] = known
        return known[1]

    def _read(self, logged: Logged, read: Callable[[int, Content], Any]) -> Sequence[bytes]:
        return (_encode(self._message(logged, read)),)

    def _message(self, logged: Logged, read: Callable[[int, Content], Any]) -> Any:
        return read(logged.log_ns - self.begin_ns, _json(logged))

    def _given_map(self, at_ns: int) -> Iterator[Picture]:
        logged = self._index.newest("map", at_ns)
        if logged is None:
            return

        def make() -> Sequence[bytes]:
            found = self._message(logged, restored.live_map)
            return (_encode(GivenMap(found.stamp_ns, found)),)

        yield Picture("GivenMap", logged.log_ns, make)

    def _localisation(self, at_ns: int) -> Iterator[Picture]:
        """Yield the localiser's state, behind the last one that knew the place."""
        logged = self._index.newest("localisation", at_ns)
        if logged is None:
            return
        before_ns = known_ns(self._lost, logged.log_ns)

        def make() -> Sequence[bytes]:
            found = self._message(logged, restored.localisation_state)
            if found.status == LocalisationStatus.LOCALISED or before_ns is None:
                return (_encode(found),)
            known = self._index.newest("localisation", before_ns)
            before = () if known is None else self._read(known, restored.localisation_state)
            return (*before, _encode(found))

        yield Picture("LocalisationState", (logged.log_ns, before_ns), make)

    def _plan(self, at_ns: int) -> Iterator[Picture]:
        path = self._index.newest("path", at_ns)
        if path is None:
            return
        others = {name: self._index.newest(name, at_ns) for name in _OF_PLAN}

        def make() -> Sequence[bytes]:
            found = {name: None if each is None else _json(each) for name, each in others.items()}
            arc, obstacles, moving, costs = (found[name] for name in _OF_PLAN)
            stamp_ns = path.log_ns - self.begin_ns
            view = PlanView(
                stamp_ns,
                restored.packed_points(_json(path), _POSE),
                b"" if arc is None else restored.packed_points(arc, _POSE),
                b"" if obstacles is None else restored.packed_points(obstacles, _POSE[:2]),
                () if moving is None else restored.moving_things(moving),
                _NO_COSTS if costs is None else restored.live_map(stamp_ns, costs),
            )
            return (_encode(view),)

        times_ns = tuple(each and each.log_ns for each in others.values())
        yield Picture("PlanView", (path.log_ns, times_ns), make)

    def _true(self, at_ns: int) -> Iterator[Picture]:
        """Yield where the simulated robot truly was."""
        number = -1
        if self._truth is not None:
            number = int(self._truth.stamps_ns.searchsorted(at_ns, "right")) - 1
        if self._truth is None or number < 0:
            return
        stamp_ns = int(self._truth.stamps_ns[number])
        x_m, y_m, theta_rad = self._truth.poses[number].tolist()
        pose = {"x_m": x_m, "y_m": y_m, "theta_rad": theta_rad, "people": (), "body": 0}
        message = {"type": "Truth", "stamp_ns": stamp_ns - self.begin_ns, **pose}
        yield Picture("Truth", stamp_ns, lambda: (_encode(message),))

    def _read_truth(self, log: Path) -> None:
        """Read the true path of a simulation."""
        try:
            for file in truth_files(log):
                self._truth = read_tum(file)
        except (RobotctlError, OSError) as error:
            self.notes.append(f"the truth is left out: {error}")

    def _outline(self, folder: Path) -> RobotOutline:
        """Return the robot, as the record beside the log says, or as far as the log does."""
        simulated = self._truth is not None
        config = _config_of(folder)
        if config is not None:
            return outline_of(config, simulated=simulated)
        said = self._index.newest("notice", self.end_ns)
        name = "" if said is None else _json(said).get("name", "")
        return RobotOutline(
            name=name or self.name,
            version=robotctl.__version__,
            simulated=simulated,
            drive="",
            holonomic=False,
            has_lidar="lidar" in self._index.topics,
            has_localiser="localisation" in self._index.topics,
            bodies=(self._body(),),
            sonars=tuple(self._sonars()),
            v_max_m_s=0.0,
            omega_max_rad_s=0.0,
            vy_max_m_s=0.0,
        )

    def _body(self) -> tuple[Polygon, ...]:
        """Return the polygons of the robot's body [m]."""
        logged = self._index.newest("outline", self.end_ns)
        try:
            if logged is not None:
                return restored.body_outlines(_json(logged))
        except _UNREADABLE:
            pass  # of a version that draws it otherwise
        self.notes.append("nothing tells the robot's size: its body is drawn 0.4 m by 0.3 m")
        return (_UNKNOWN_BODY,)

    def _sonars(self) -> Iterator[SonarOutline]:
        """Yield the sonars that the log places."""
        logged = self._index.newest("sensor_frames", self.end_ns)
        for each in [] if logged is None else _json(logged)["transforms"]:
            name = each["child_frame_id"]
            if name.startswith("sonar_"):
                at, turned = each["translation"], each["rotation"]
                heading_rad = 2.0 * math.atan2(turned["z"], turned["w"])
                yield SonarOutline(name.removeprefix("sonar_"), at["x"], at["y"], heading_rad)


def _json(logged: Logged) -> Any:
    """Return the content of a message."""
    return msgspec.json.decode(logged.data)


def _config_of(folder: Path) -> RobotConfig | None:
    """Return the configuration in the newest record of a folder; None: there is none to read."""
    for path in sorted(folder.glob("control-*.rec"), reverse=True):
        try:
            with path.open("rb") as file:
                header, _ = read_record(file, str(path))
            return robot_of_json(header.robot_json)
        except (RobotctlError, OSError):
            continue
    return None
