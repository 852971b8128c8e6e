"""Messages in the schemas that Foxglove and similar viewers display without configuration.

Names and fields are those of https://docs.foxglove.dev/docs/sdk/schemas; `data` of bytes is base64
in JSON. Frames are `world`, `odom`, `base`, `lidar`, `camera` and `sonar_NAME`, as in
docs/architecture.md. A range of a scan must be a number and its place counts: see `scan_ranges`.
"""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Iterable
from typing import Final

import msgspec

from robotctl.messages.control import Notice
from robotctl.messages.estimation import LidarScan, LiveMap
from robotctl.model.geometry.se2 import SE2

WORLD: Final = "world"
ODOM: Final = "odom"
BASE: Final = "base"
LIDAR: Final = "lidar"
CAMERA: Final = "camera"

OUT_OF_RANGE_M: Final = 1e6
"""Range in a scan without an echo within `max_range`, too far for viewers to show [m]."""

_UINT8, _INT8, _FLOAT32 = 1, 2, 7
"""`foxglove.NumericType`."""

_LEVELS: Final = ((3, 5), (4, 4), (5, 3), (7, 2))
"""Upper bounds of the severity of RFC 5424, each with its level of `foxglove.Log`."""


class Time(msgspec.Struct, frozen=True, gc=False):
    """Wall time, since 1970."""

    sec: int
    nsec: int


class Vector3(msgspec.Struct, frozen=True, gc=False):
    """A place or a direction [m]."""

    x: float
    y: float
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True, gc=False):
    """A rotation."""

    x: float
    y: float
    z: float
    w: float


class Pose(msgspec.Struct, frozen=True, gc=False):
    """Position and orientation of a frame or an object."""

    position: Vector3
    orientation: Quaternion


class FrameTransform(msgspec.Struct, frozen=True, gc=False):
    """`T_parent_child`."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class FrameTransforms(msgspec.Struct, frozen=True):
    """Several transforms."""

    transforms: tuple[FrameTransform, ...]


class PoseInFrame(msgspec.Struct, frozen=True, gc=False):
    """A pose, with its heading [rad] for plots."""

    timestamp: Time
    frame_id: str
    pose: Pose
    theta_rad: float


class PackedElementField(msgspec.Struct, frozen=True, gc=False):
    """Field at `offset` of each element of `data`."""

    name: str
    offset: int
    type: int


class Vector2(msgspec.Struct, frozen=True, gc=False):
    """Lengths along two axes [m]."""

    x: float
    y: float


class Grid(msgspec.Struct, frozen=True):
    """A map of cells by rows, the first at the pose."""

    timestamp: Time
    frame_id: str
    pose: Pose
    column_count: int
    cell_size: Vector2
    row_stride: int
    cell_stride: int
    fields: tuple[PackedElementField, ...]
    data: bytes


class PointCloud(msgspec.Struct, frozen=True):
    """Points, `point_stride` bytes each."""

    timestamp: Time
    frame_id: str
    pose: Pose
    point_stride: int
    fields: tuple[PackedElementField, ...]
    data: bytes


class LaserScan(msgspec.Struct, frozen=True, omit_defaults=True):
    """A scan of a lidar [rad, m], with its maximum range [m].

    The name of a lidar among several, and the time of its sweep [s], are fields of ours; they are
    as in `LidarScan`.
    """

    timestamp: Time
    frame_id: str
    pose: Pose
    start_angle: float
    end_angle: float
    ranges: list[float]
    intensities: list[float]
    max_range: float
    name: str | None = None
    sweep_s: float | None = None


class Log(msgspec.Struct, frozen=True):
    """A line of text, for log panels."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str
    line: int


UPRIGHT: Final = Quaternion(0.0, 0.0, 0.0, 1.0)
AT_ORIGIN: Final = Pose(Vector3(0.0, 0.0), UPRIGHT)
_POSE: Final = (
    PackedElementField("x", 0, _FLOAT32),
    PackedElementField("y", 4, _FLOAT32),
    PackedElementField("theta", 8, _FLOAT32),
)
_CELL: Final = (
    PackedElementField("red", 0, _UINT8),
    PackedElementField("green", 1, _UINT8),
    PackedElementField("blue", 2, _UINT8),
    PackedElementField("alpha", 3, _UINT8),
    PackedElementField("occupancy", 4, _INT8),
)
_UNKNOWN: Final = 205
"""Grey of an unknown cell, as in ROS maps."""

_GREYS: Final = bytes(254 - 254 * cell // 100 if cell <= 100 else _UNKNOWN for cell in range(256))
"""Grey by the cell as an unsigned byte."""


def time_of(wall_ns: int) -> Time:
    """Return a wall time [ns since 1970]."""
    seconds, nanoseconds = divmod(wall_ns, 1_000_000_000)
    return Time(seconds, nanoseconds)


def turned(theta_rad: float) -> Quaternion:
    """Return the rotation by an angle about z [rad]."""
    return Quaternion(0.0, 0.0, math.sin(0.5 * theta_rad), math.cos(0.5 * theta_rad))


def planar_transform(wall_ns: int, parent: str, child: str, T_parent_child: SE2) -> FrameTransform:
    """Return the transform between two frames in the plane."""
    return FrameTransform(
        time_of(wall_ns),
        parent,
        child,
        Vector3(T_parent_child.x_m, T_parent_child.y_m),
        turned(T_parent_child.theta_rad),
    )


def pose_in(wall_ns: int, frame: str, pose: SE2) -> PoseInFrame:
    """Return a pose of `base` in a frame of the plane."""
    at = Pose(Vector3(pose.x_m, pose.y_m), turned(pose.theta_rad))
    return PoseInFrame(time_of(wall_ns), frame, at, pose.theta_rad)


def laser_scan(wall_ns: int, scan: LidarScan) -> LaserScan | None:
    """Return a scan; None if a driver sent an invalid one.

    Its frame is `base`, with the lidar's pose there, so that it is right even if a cut log has lost
    the frame `lidar`.
    """
    numbers = (
        scan.x_m, scan.y_m, scan.first_rad, scan.step_rad, scan.max_range_m, scan.sweep_s,
    )  # fmt: skip
    if len(scan.ranges) % 4 or not all(map(math.isfinite, numbers)):
        return None
    ranges = array("f", scan.ranges)
    if sys.byteorder == "big":
        ranges.byteswap()
    return LaserScan(
        time_of(wall_ns),
        BASE,
        Pose(Vector3(scan.x_m, scan.y_m), UPRIGHT),
        scan.first_rad,
        scan.first_rad + scan.step_rad * (len(ranges) - 1),
        scan_ranges(ranges),
        [],
        scan.max_range_m,
        scan.name or None,
        scan.sweep_s or None,
    )


def scan_ranges(ranges_m: Iterable[float]) -> list[float]:
    """Return ranges to 0.1 mm for JSON, which has neither infinity nor nan [m].

    `OUT_OF_RANGE_M` stands for infinity, its negative for nan (no valid reading).
    """
    # A third of the time of `round`, which would cost as much as the rest of a log of states.
    return [
        int(range_m * 1e4 + 0.5) / 1e4
        if -OUT_OF_RANGE_M < range_m < OUT_OF_RANGE_M
        else OUT_OF_RANGE_M
        if range_m > 0.0
        else -OUT_OF_RANGE_M
        for range_m in ranges_m
    ]


def grid(wall_ns: int, world_map: LiveMap) -> Grid:
    """Return a map in `world`, grey as ROS maps are; `occupancy` is its percentage, -1 unknown."""
    size, stride = len(world_map.cells), len(_CELL)
    data = bytearray(b"\xff") * (size * stride)
    greys = world_map.cells.translate(_GREYS)
    for channel in range(3):
        data[channel::stride] = greys
    data[4::stride] = world_map.cells
    return Grid(
        time_of(wall_ns),
        WORLD,
        Pose(Vector3(world_map.x_m, world_map.y_m), turned(world_map.theta_rad)),
        world_map.columns,
        Vector2(world_map.resolution_m, world_map.resolution_m),
        world_map.columns * stride,
        stride,
        _CELL,
        bytes(data),
    )


def point_cloud(wall_ns: int, poses: bytes) -> PointCloud:
    """Return poses of `world`, packed as those of `ParticleCloud`."""
    return PointCloud(time_of(wall_ns), WORLD, AT_ORIGIN, 12, _POSE, poses)


def place_cloud(wall_ns: int, places: bytes) -> PointCloud:
    """Return places of `world`, float32 x and y of each [m]."""
    return PointCloud(time_of(wall_ns), WORLD, AT_ORIGIN, 8, _POSE[:2], places)


def severity_of(level: int) -> int:
    """Return the severity of RFC 5424 of a level of `log_line`."""
    return {5: 2, 4: 3, 3: 4, 2: 5}.get(level, 7)


def log_line(wall_ns: int, notice: Notice, name: str) -> Log:
    """Return a notice of the robot of this name."""
    level = next((level for below, level in _LEVELS if notice.severity < below), 1)
    return Log(time_of(wall_ns), level, notice.text, name, "", 0)
