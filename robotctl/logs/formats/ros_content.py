"""Content of a ROS bag: poses, scans and frames as values, each by its source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.ros_frames import Edge, Frames
from robotctl.logs.formats.ros_messages import bag_messages
from robotctl.logs.formats.timeline import Series, Timeline
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.se3 import SE3
from robotctl.words import counted

SCAN: Final = "sensor_msgs/msg/LaserScan"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
TF: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_WIDEST_RAD: Final = 4.0 * math.pi
"""Maximum angle of a scan [rad]."""


class OdometrySource(NamedTuple):
    """An Odometry topic with the frames of its messages; a source of a log."""

    topic: str
    frame: str
    child: str

    def __str__(self) -> str:
        return f"poses of {self.topic}"


class ScanSource(NamedTuple):
    """A LaserScan topic with the frame of its messages; a source of a log."""

    topic: str
    frame: str

    def __str__(self) -> str:
        return f"scans of {self.topic}"


@dataclass(frozen=True, slots=True)
class RawScan:
    """A LaserScan as in its message; ranges below `range_min` are nan.

    `sweep_s` is the time from the first ray, which has that of the message, to the last; 0 if the
    message says nothing of use.
    """

    first_rad: float
    step_rad: float
    ranges_m: NDArray[np.float32]
    max_range_m: float
    sweep_s: float


_LONGEST_S: Final = 1.0
_Source: TypeAlias = OdometrySource | ScanSource | Edge


@dataclass(frozen=True, slots=True)
class BagContent:
    """Content of a bag that matters for the drive of a robot.

    Parameters
    ----------
    odometry
        Odometry by source, with rows (x [m], y [m], theta [rad]).
    scans
        `RawScan`s by source.
    frames
        Frames of the tf messages.
    tf_topics
        Topics with tf messages.
    """

    odometry: Mapping[OdometrySource, Series]
    scans: Mapping[ScanSource, Series]
    frames: Frames
    tf_topics: frozenset[str]


def content_of(path: Path, notes: list[str]) -> BagContent:
    """Return the content of a bag; omissions are noted.

    Raises
    ------
    ConfigError, LogFormatError, OSError
        See `bag_messages`.
    """
    timeline: Timeline[_Source] = Timeline(notes)
    tf_topics, unstamped = set(), 0
    for topic, kind, message, raw, log_ns in bag_messages(path, (SCAN, ODOMETRY, *TF)):
        if kind in TF:
            tf_topics.add(topic)
        parts = message.transforms if kind in TF else (message,)
        for part in parts:
            stamp_ns = int(part.header.stamp.sec) * 1_000_000_000 + int(part.header.stamp.nanosec)
            unstamped += stamp_ns == 0
            source = _source(topic, kind, part)
            try:
                value = _value(kind, part)
            except ValueError as error:
                timeline.leave_out(source, stamp_ns or log_ns, str(error))
            else:
                timeline.add(source, stamp_ns or log_ns, value, None if kind in TF else raw, log_ns)
    if unstamped:
        notes.append(f"{counted(unstamped, 'message')} without a time: that of the log counts")
    sources = timeline.sources()
    edges = [each for each in sources if isinstance(each, Edge)]
    says_motion = any(isinstance(each, OdometrySource) for each in sources)
    found = timeline.settled(
        details=edges if says_motion else (), timeless=[each for each in edges if each.is_static]
    )
    return BagContent(
        {each: found[each] for each in sources if isinstance(each, OdometrySource)},
        {each: found[each] for each in sources if isinstance(each, ScanSource)},
        Frames({each: found[each] for each in edges}, notes),
        frozenset(tf_topics),
    )


def _source(topic: str, kind: str, message: Any) -> _Source:
    """Return the source of a message, or of a part of a tf message."""
    frame = _name(message.header.frame_id)
    if kind == SCAN:
        return ScanSource(topic, frame)
    child = _name(message.child_frame_id)
    if kind == ODOMETRY:
        return OdometrySource(topic, frame, child)
    return Edge(child, frame, topic.endswith("tf_static"))


def _value(kind: str, message: Any) -> object:
    """Return the value of a message; raises `ValueError` if impossible."""
    if kind == SCAN:
        return _scan(message)
    if kind == ODOMETRY:
        pose = message.pose.pose
        at = in_plane(_se3(pose.position, pose.orientation))
        return at.x_m, at.y_m, at.theta_rad
    return _se3(message.transform.translation, message.transform.rotation)


def _scan(message: Any) -> RawScan:
    """Return a scan; raises as `_value`."""
    numbers = {
        name: float(getattr(message, name))
        for name in ("angle_min", "angle_increment", "range_min", "range_max")
    }
    for name in ("angle_min", "angle_increment", "range_min"):
        if not math.isfinite(numbers[name]):
            raise ValueError(f"{name} is {numbers[name]}")
    ranges = np.asarray(message.ranges, np.float32)
    if not len(ranges):
        raise ValueError("it has no ranges")
    if abs(numbers["angle_min"]) + abs(numbers["angle_increment"]) * len(ranges) > _WIDEST_RAD:
        raise ValueError(
            f"{len(ranges)} ranges from angle_min {numbers['angle_min']:g} on, by "
            f"angle_increment {numbers['angle_increment']:g}, are beyond two turns"
        )
    return RawScan(
        numbers["angle_min"],
        numbers["angle_increment"],
        np.where(ranges >= numbers["range_min"], ranges, math.nan).astype(np.float32),
        numbers["range_max"] if numbers["range_max"] > 0.0 else math.inf,
        _sweep_s(float(message.time_increment), len(ranges)),
    )


def _sweep_s(increment_s: float, count: int) -> float:
    """Return the time of a sweep; 0 if no lidar takes so long."""
    sweep_s = increment_s * (count - 1)
    return sweep_s if 0.0 < sweep_s <= _LONGEST_S else 0.0


def _name(frame: str) -> str:
    """Return the name of a frame, which ROS 1 may begin with a slash."""
    return frame.lstrip("/")


def _se3(translation: Any, rotation: Any) -> SE3:
    """Return a pose of ROS; its quaternion may be all 0, an unknown orientation.

    Raises as `_value`.
    """
    x_m, y_m, z_m = (float(getattr(translation, key)) for key in "xyz")
    w, x, y, z = (float(getattr(rotation, key)) for key in "wxyz")
    if not all(map(math.isfinite, (x_m, y_m, z_m))):
        raise ValueError(f"the position is {x_m:g}, {y_m:g}, {z_m:g}")
    if not all(map(math.isfinite, (w, x, y, z))):
        raise ValueError(f"the orientation is {x:g}, {y:g}, {z:g}, {w:g}")
    return SE3((x_m, y_m, z_m), (w, x, y, z) if any((w, x, y, z)) else (1.0, 0.0, 0.0, 0.0))


def in_plane(pose: SE3) -> SE2:
    """Return a pose in the plane, with the direction of its x axis as heading."""
    x_axis = pose.rotation()[:, 0]
    return SE2(*pose.translation_m[:2], math.atan2(float(x_axis[1]), float(x_axis[0])))
