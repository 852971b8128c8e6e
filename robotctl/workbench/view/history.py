"""A whole run at once: path driven, states, notices, and fields over time."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.logs.mcap.restored import control_state, localisation_state, notice
from robotctl.messages.control import Notice, SafetyState
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.web.replay_wire import History, Series, Stretch
from robotctl.workbench.view.index import Logged, RunIndex

MOST_POINTS: Final = 20_000
"""Most points of the path driven; a longer one is coarser."""
_STEP_M: Final = 0.02
_MOST_NOTICES: Final = 5_000
MOST_ROWS: Final = 200_000
"""Most rows of a field; of a longer run the least and the greatest value of several are kept."""

TOPICS: Final[Mapping[str, str]] = {
    "ControlState": "control",
    "NavigationState": "navigation",
    "LocalisationState": "localisation",
    "CameraView": "camera",
}
"""Topic of the log by the message's name, of the messages with fields to plot."""

_RENAMED: Final = (
    (
        re.compile(r"^(x_m|y_m|theta_rad)$"),
        {"control": r"T_odom_base.\1", "localisation": r"T_world_odom.\1"},
    ),
    (re.compile(r"^sonar_m\[(\d+)\]$"), {"control": r"sonars[\1].range_m"}),
    (re.compile(r"^ranges_m\[(\d+)\]$"), {"camera": r"beams[\1].range_m"}),
    (re.compile(r"^angles_rad\[(\d+)\]$"), {"camera": r"beams[\1].angle_rad"}),
    (re.compile(r"^sigmas_m\[(\d+)\]$"), {"camera": r"beams[\1].sigma_m"}),
    (re.compile(r"^nearest_m\[(\d+)\]$"), {"camera": r"beams[\1].nearest_m"}),
)
"""Names of fields that are others in a log."""


class _Pose(msgspec.Struct):
    x_m: float = math.nan
    y_m: float = math.nan
    theta_rad: float = math.nan

    def fields(self) -> dict[str, float]:
        """Return it as fields of a message."""
        return {"x_m": self.x_m, "y_m": self.y_m, "theta_rad": self.theta_rad}


class _Control(_Pose):
    """Used part of a control state; in older versions the pose is its own."""

    state: int = 0
    reason: str = ""
    odom_epoch_ns: int = 0
    T_odom_base: _Pose | None = None


class _Localisation(_Pose):
    """Used part of a state of the localiser, as above."""

    status: int = 0
    odom_epoch_ns: int = 0
    epoch_ns: int = 0
    T_world_odom: _Pose | None = None


_decode_control: Final = msgspec.json.Decoder(_Control).decode
_decode_localisation: Final = msgspec.json.Decoder(_Localisation).decode


@dataclass(slots=True)
class _Path:
    """Path driven, no two points of a stretch nearer than a step."""

    step_m: float = _STEP_M
    times_ns: list[int] = field(default_factory=list)
    points: list[tuple[float, float]] = field(default_factory=list)
    begins: list[bool] = field(default_factory=list)
    epoch: object = None

    def add(self, at_ns: int, x_m: float, y_m: float, epoch: object) -> None:
        """Add a place, where `epoch` changes when the pose jumps."""
        begins = epoch != self.epoch
        self.epoch = epoch
        if not begins and math.dist(self.points[-1], (x_m, y_m)) < self.step_m:
            return
        self.times_ns.append(at_ns)
        self.points.append((x_m, y_m))
        self.begins.append(begins)
        if len(self.points) > MOST_POINTS:
            self._thin()

    def _thin(self) -> None:
        """Keep every second point, and the first of each stretch."""
        kept = [begins or number % 2 == 0 for number, begins in enumerate(self.begins)]
        self.times_ns = list(compress(self.times_ns, kept))
        self.points = list(compress(self.points, kept))
        self.begins = list(compress(self.begins, kept))
        self.step_m *= 2.0


class Lost(NamedTuple):
    """Time from which the robot did not know its place, and when it last had [ns]."""

    begin_ns: int
    known_ns: int


class HistoryReader:
    """Reads a whole run once.

    Parameters
    ----------
    index
        The run.
    notes
        Sentences on what is missing in it.

    Attributes
    ----------
    lost
        Times without a known place, in their order.
    """

    def __init__(self, index: RunIndex, notes: Sequence[str]) -> None:
        self._index = index
        self._notes = tuple(notes)
        self._path = _Path()
        self._stretches: list[Stretch] = []
        self._notices: list[Notice] = []
        self._world = WorldPose(has_localiser="localisation" in index.topics)
        self._control = control_state(0, {})
        self._localisation = localisation_state(0, {})
        self._known_ns: int | None = None
        self.lost: list[Lost] = []

    def read(self) -> History:
        """Return the history."""
        for topic, logged in self._index.scan(("localisation", "control", "notice")):
            try:
                self._take(topic, logged)
            except (msgspec.DecodeError, LookupError, TypeError, ValueError):
                continue  # damaged, or of a version that wrote something else
        path = self._path
        times_ns = np.array(path.times_ns, np.float64)
        driving = (each.begin_ns for each in self._stretches if each.state == SafetyState.DRIVING)
        return History(
            (times_ns / 1e9).astype("<f8").tobytes(),
            np.array(path.points, "<f4").tobytes(),
            np.array(path.begins, np.bool_).tobytes(),
            tuple(self._stretches),
            tuple(self._notices[-_MOST_NOTICES:]),
            next(driving, None),
            self._index.end_ns - self._index.begin_ns,
            self._notes,
        )

    def _take(self, topic: str, logged: Logged) -> None:
        at_ns = logged.log_ns - self._index.begin_ns
        if topic == "control":
            self._take_control(at_ns, _decode_control(logged.data))
        elif topic == "localisation":
            self._take_localisation(logged.log_ns, _decode_localisation(logged.data))
        else:
            self._notices.append(notice(at_ns, msgspec.json.decode(logged.data)))

    def _take_control(self, at_ns: int, logged: _Control) -> None:
        last = self._stretches[-1] if self._stretches else None
        if last is None or (last.state, last.reason) != (logged.state, logged.reason):
            self._stretches.append(Stretch(at_ns, logged.state, logged.reason))
        pose = logged if logged.T_odom_base is None else logged.T_odom_base
        control = msgspec.structs.replace(
            self._control, odom_epoch_ns=logged.odom_epoch_ns, **pose.fields()
        )
        here = self._world.pose(control)
        if here is not None and math.isfinite(here.x_m) and math.isfinite(here.y_m):
            self._path.add(at_ns, here.x_m, here.y_m, self._world.epoch(control))

    def _take_localisation(self, log_ns: int, logged: _Localisation) -> None:
        pose = logged if logged.T_world_odom is None else logged.T_world_odom
        status = LocalisationStatus(logged.status)
        self._world.localise(
            msgspec.structs.replace(
                self._localisation,
                status=status,
                odom_epoch_ns=logged.odom_epoch_ns,
                epoch_ns=logged.epoch_ns,
                **pose.fields(),
            )
        )
        if status is LocalisationStatus.LOCALISED:
            self._known_ns = log_ns
        elif self._known_ns is not None:
            self.lost.append(Lost(log_ns, self._known_ns))
            self._known_ns = None


def known_ns(lost: Sequence[Lost], at_ns: int) -> int | None:
    """Return when the robot last knew its place, of one that does not at a time [ns]."""
    number = bisect_right(lost, at_ns, key=lambda each: each.begin_ns) - 1
    return lost[number].known_ns if number >= 0 else None


def series_of(index: RunIndex, names: Iterable[str]) -> list[Series]:
    """Return fields over a whole run, those of which nothing is logged without a row.

    Parameters
    ----------
    index
        The run.
    names
        `MESSAGE.PATH` each, as `ControlState.duty[0]`.
    """
    paths: dict[str, list[str]] = {}
    for name in names:
        message, _, path = name.partition(".")
        paths.setdefault(message, []).append(path)
    found = []
    for message, of_message in paths.items():
        topic = TOPICS.get(message)
        rows = _rows(index, topic, of_message) if topic else np.empty((0, 1 + len(of_message)))
        for number, path in enumerate(of_message, 1):
            times_s, values = _decimated(rows[:, 0], rows[:, number])
            times, packed = times_s.astype("<f8").tobytes(), values.astype("<f4").tobytes()
            found.append(Series(f"{message}.{path}", times, packed))
    return found


def _rows(index: RunIndex, topic: str, paths: Sequence[str]) -> NDArray[np.float64]:
    """Return times [s] and values of fields of a topic, (n, 1 + fields)."""
    ways = [[_keys(each) for each in (_renamed(topic, path), path)] for path in paths]
    tops = dict.fromkeys(str(way[0]) for both in ways for way in both)
    kind = msgspec.defstruct("Part", [(name, Any, None) for name in tops])
    decode = msgspec.json.Decoder(kind).decode
    rows = []
    for _, logged in index.scan((topic,)):
        try:
            part = decode(logged.data)
        except msgspec.DecodeError:
            continue
        row = [(logged.log_ns - index.begin_ns) / 1e9]
        for both in ways:
            values = (_value(getattr(part, str(way[0])), way[1:]) for way in both)
            row.append(next((each for each in values if each is not None), math.nan))
        rows.append(row)
    return np.array(rows, np.float64).reshape(-1, 1 + len(paths))


def _renamed(topic: str, path: str) -> str:
    """Return the path of a field in the log."""
    for pattern, names in _RENAMED:
        if topic in names and pattern.match(path):
            return pattern.sub(names[topic], path)
    return path


def _keys(path: str) -> list[str | int]:
    """Return the names and numbers that lead to a field; none where it is no path."""
    parts = [each for each in re.split(r"[.\[\]]+", path) if each]
    keys = [int(each) if each.isdecimal() else each for each in parts]
    return keys if keys and str(keys[0]).isidentifier() else ["stamp_ns", "none"]


def _value(found: Any, keys: Sequence[str | int]) -> float | None:
    """Return the number at a path below a value; None: there is none."""
    for key in keys:
        if isinstance(found, dict):
            found = found.get(key)
        elif isinstance(found, list) and isinstance(key, int) and key < len(found):
            found = found[key]
        else:
            return None
    return float(found) if isinstance(found, int | float) else None


def _decimated(
    times: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and values, of many rows the least and the greatest of each few."""
    size = math.ceil(len(times) / (MOST_ROWS // 2))
    if size <= 2:
        return times, values
    groups = values[: len(values) // size * size].reshape(-1, size)
    least = np.where(np.isnan(groups), np.inf, groups).argmin(1)
    greatest = np.where(np.isnan(groups), -np.inf, groups).argmax(1)
    kept = np.sort([least, greatest], axis=0) + np.arange(len(groups)) * size
    return times[kept.T.ravel()], values[kept.T.ravel()]
