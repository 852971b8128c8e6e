"""ROS 1 bags, ROS 2 bags (SQLite and MCAP) and MCAP files of ROS 2 as drives; needs rosbags.

Read are LaserScan, Odometry and tf messages, whatever their topics are called. `base` is the child
frame of the odometry. tf gives the laser's mounting: it may be off centre, rotated or upside down,
but must be level. Without Odometry messages the motion of a frame in one called odom counts. The
reference is the pose of `base` in the frame above odom, such as map, which the robot's own
localiser published; better is an Odometry topic whose name says that it is the truth.

A reading at or above `range_max` or one of the lengths that `no_echo` finds is inf, one below
`range_min` is none (nan). Times are those of the message headers.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.no_echo import reaches, valid_ranges
from robotctl.logs.formats.ros_frames import Frames
from robotctl.logs.formats.times import in_order
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.se3 import SE3
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory
from robotctl.words import counted

SCAN: Final = "sensor_msgs/msg/LaserScan"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
TF: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_ROS1: Final = b"#ROSBAG V2.0"
_SQLITE: Final = b"SQLite format 3\0"
_MCAP: Final = b"\x89MCAP0\r\n"
_OWN: Final = b"robotctl"
_HEAD_BYTES: Final = 256
_TRUTH: Final = re.compile(r"truth|(^|[/_])gt([/_]|$)|mocap|vicon|optitrack", re.IGNORECASE)
_BASES: Final = ("base_footprint", "base_link", "base")
_LEVEL: Final = math.cos(math.radians(5.0))


@dataclass(slots=True)
class _Content:
    """Content of a bag's messages; times are [ns]."""

    scans: dict[str, list[tuple[int, Any]]] = field(default_factory=lambda: defaultdict(list))
    odometry: dict[str, list[tuple[int, SE2]]] = field(default_factory=lambda: defaultdict(list))
    frames_of: dict[str, tuple[str, str]] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    notes: list[str] = field(default_factory=list)
    unstamped: int = 0


def is_ros_bag(path: Path) -> bool:
    """Return whether a file or a folder is a bag, by its content."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_bags_in(path))
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return head.startswith((_ROS1, _SQLITE)) or (head.startswith(_MCAP) and _OWN not in head)


def _bags_in(folder: Path) -> list[Path]:
    """Return the parts of a ROS 1 bag, or the one file of a ROS 2 bag without its metadata."""
    parts = sorted(folder.glob("*.bag"))
    single = [*folder.glob("*.db3"), *folder.glob("*.mcap")]
    return parts or (single if len(single) == 1 and is_ros_bag(single[0]) else [])


def read_ros_bag(path: Path, max_range_m: float | None = None) -> Recording:
    """Read a bag.

    Parameters
    ----------
    path
        A file, or the folder of a bag.
    max_range_m
        Ranges from here on are no echoes [m]; None: found out as above.

    Raises
    ------
    ConfigError
        If the package rosbags is not installed.
    LogFormatError
        If it is damaged, or no motion of a robot is in it.
    OSError
        If it cannot be read.
    """
    content = _content(path)
    notes = content.notes
    if content.unstamped:
        messages = counted(content.unstamped, "message")
        notes.append(f"{messages} without a time: that of the log counts")
    topic, odometry, odom, base = _odometry(path, content)
    notes.append(f"odometry: {topic}, {base} in {odom}")
    reference = _reference(content, odometry, odom, base)
    scans = _scans(content, odometry, reference, base, max_range_m)
    return Recording(
        name=path.name,
        scans=tuple(scans),
        odometry=odometry,
        reference=reference,
        notes=tuple(notes),
    )


def _content(path: Path) -> _Content:
    """Take in the messages of a bag."""
    try:
        import apsw  # noqa: PLC0415 - with rosbags
        from rosbags.highlevel import AnyReader, AnyReaderError  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            f"{path}: a ROS bag, for which rosbags is needed, and it is not installed; install it "
            "with\n  sudo /opt/robotctl/bin/pip install '/opt/robotctl-source[bags]'\n"
            "where these are the installation and your copy of robotctl (in a checkout: make setup)"
        ) from None
    files = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        files = _bags_in(path)
    content = _Content()
    try:
        store = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader(files, default_typestore=store) as reader:
            wanted = [each for each in reader.connections if each.msgtype in (SCAN, ODOMETRY, *TF)]
            if not wanted:
                kinds = Counter(each.msgtype for each in reader.connections)
                raise LogFormatError(
                    f"{path}: neither LaserScan nor Odometry nor tf messages in it, but "
                    f"{', '.join(kinds) or 'nothing'}"
                )
            for connection, log_ns, data in reader.messages(wanted):
                message = reader.deserialize(data, connection.msgtype)
                _take_in(content, connection.topic, connection.msgtype, message, log_ns)
    except AnyReaderError as error:
        raise LogFormatError(f"{path}: {error}") from error
    except (apsw.Error, AssertionError, KeyError, ValueError, EOFError, IndexError) as error:
        # What rosbags raises on damaged files, beside its own errors.
        raise LogFormatError(f"{path}: the bag is damaged: {error!r}") from error
    return content


def _take_in(content: _Content, topic: str, kind: str, message: Any, log_ns: int) -> None:
    """Take in one message."""
    if kind in TF:
        for each in message.transforms:
            content.frames.add(
                _name(each.header.frame_id),
                _name(each.child_frame_id),
                _stamp_ns(content, each.header, log_ns),
                _se3(each.transform.translation, each.transform.rotation),
                is_static=topic.endswith("tf_static"),
            )
    elif kind == SCAN:
        content.scans[topic].append((_stamp_ns(content, message.header, log_ns), message))
    else:
        pose = message.pose.pose
        content.odometry[topic].append(
            (
                _stamp_ns(content, message.header, log_ns),
                _se2(_se3(pose.position, pose.orientation)),
            )
        )
        content.frames_of[topic] = _name(message.header.frame_id), _name(message.child_frame_id)


def _name(frame: str) -> str:
    """Return the name of a frame; ROS 1 could begin it with a slash."""
    return frame.lstrip("/")


def _stamp_ns(content: _Content, header: Any, log_ns: int) -> int:
    """Return the time of a message [ns]; the log's time if it has none."""
    stamp_ns = int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
    if stamp_ns == 0:
        content.unstamped += 1
    return stamp_ns or log_ns


def _se3(translation: Any, rotation: Any) -> SE3:
    """Return a pose of ROS; its quaternion may be all 0, an unknown orientation."""
    quaternion = tuple(float(getattr(rotation, key)) for key in "wxyz")
    w, x, y, z = quaternion if any(quaternion) else (1.0, 0.0, 0.0, 0.0)
    return SE3((float(translation.x), float(translation.y), float(translation.z)), (w, x, y, z))


def _se2(pose: SE3) -> SE2:
    """Return a pose in the plane: its heading is where its x axis points."""
    x_axis = pose.rotation()[:, 0]
    return SE2(*pose.translation_m[:2], math.atan2(float(x_axis[1]), float(x_axis[0])))


def _odometry(path: Path, content: _Content) -> tuple[str, Trajectory, str, str]:
    """Return the topic of the odometry, its trajectory, its frame and that of `base`."""
    topics = [topic for topic in content.odometry if not _TRUTH.search(topic)]
    if topics:
        topic = max(topics, key=lambda each: (each.endswith("/odom"), len(content.odometry[each])))
        if len(topics) > 1:
            content.notes.append(f"odometry in {', '.join(sorted(topics))}: {topic} is taken")
        odom, base = content.frames_of[topic]
        return topic, _trajectory(content, topic), odom or "odom", base or _base(content) or "base"
    base = _base(content) or ""
    chain = content.frames.chain(base) if base else []
    odom = next((frame for frame in chain[1:] if "odom" in frame), chain[-1] if chain else "")
    moving = [frame for frame in chain[: len(chain) - 1] if content.frames.moves(frame)]
    if not moving or odom == base:
        raise LogFormatError(
            f"{path}: nothing says how the robot moves: neither nav_msgs/Odometry nor tf of "
            f"{' or '.join(_BASES)}"
        )
    stamps_ns = sorted({at for frame in moving for at in content.frames.stamps_ns(frame)})
    poses = [content.frames.lookup(odom, base, stamp_ns) or SE3() for stamp_ns in stamps_ns]
    return "tf", Trajectory.of(stamps_ns, map(_se2, poses)), odom, base


def _base(content: _Content) -> str | None:
    """Return the robot's frame in tf."""
    return next((base for base in _BASES if len(content.frames.chain(base)) > 1), None)


def _trajectory(content: _Content, topic: str) -> Trajectory:
    """Return the poses of an Odometry topic."""
    entries = content.odometry[topic]
    stamps_ns, held = in_order(np.array([stamp_ns for stamp_ns, _ in entries]))
    if held:
        content.notes.append(f"{held} of {len(entries)} of {topic}: their clock goes back, held")
    return Trajectory.of(stamps_ns.tolist(), (pose for _, pose in entries))


def _reference(content: _Content, odometry: Trajectory, odom: str, base: str) -> Trajectory | None:
    """Return `base` in something better than odometry; None if there is nothing."""
    truths = [topic for topic in content.odometry if _TRUTH.search(topic)]
    if truths:
        content.notes.append(f"reference: {truths[0]}")
        return _trajectory(content, truths[0])
    frames = content.frames
    above = frames.chain(odom)
    if any(map(frames.moves, above[:-1])):
        world = "map" if "map" in above else above[-1]
        corrections = (
            frames.lookup(world, odom, stamp_ns) or SE3()
            for stamp_ns in odometry.stamps_ns.tolist()
        )
        poses = [
            _se2(correction) @ SE2(*row)
            for correction, row in zip(corrections, odometry.poses.tolist(), strict=True)
        ]
    elif len(above) == 1 and odom not in frames.chain(base) and frames.moves(base):
        world = frames.chain(base)[-1]
        stamps_ns = odometry.stamps_ns.tolist()
        poses = [_se2(frames.lookup(world, base, stamp_ns) or SE3()) for stamp_ns in stamps_ns]
    else:
        content.notes.append("no reference: no tf of a frame above the odometry's that moves")
        return None
    content.notes.append(
        f"reference: {base} in {world} by tf, of the robot's own localiser or mapper"
    )
    return Trajectory.of(odometry.stamps_ns.tolist(), poses)


def _scans(
    content: _Content,
    odometry: Trajectory,
    reference: Trajectory | None,
    base: str,
    max_range_m: float | None,
) -> list[RecordedScan]:
    """Return the scans of all lasers in the order of their times."""
    found: list[RecordedScan] = []
    seen: dict[str, str] = {}
    for topic in sorted(content.scans, key=lambda each: (-len(content.scans[each]), each)):
        messages = sorted(content.scans[topic], key=lambda entry: entry[0])
        frame = _name(messages[0][1].header.frame_id)
        if frame in seen:
            content.notes.append(f"{topic}: of the laser of {seen[frame]}, left out")
            continue
        seen[frame] = topic
        found += _of_laser(content, topic, frame, messages, odometry, reference, base, max_range_m)
    return sorted(found, key=lambda entry: entry.scan.stamp_ns)


def _of_laser(
    content: _Content,
    topic: str,
    frame: str,
    messages: Sequence[tuple[int, Any]],
    odometry: Trajectory,
    reference: Trajectory | None,
    base: str,
    max_range_m: float | None,
) -> Iterator[RecordedScan]:
    """Yield the scans of one laser."""
    known = [each for each in (base, *_BASES) if content.frames.lookup(each, frame, 0) is not None]
    if not known:
        content.notes.append(
            f"{topic}: tf does not say where {frame} is in {base}: taken for the same"
        )
    elif known[0] != base:
        content.notes.append(f"{topic}: tf says where {frame} is in {known[0]}: taken for {base}")
    base = known[0] if known else base
    begin_ns, end_ns = int(odometry.stamps_ns[0]), int(odometry.stamps_ns[-1])
    at = [odometry.at(min(max(stamp_ns, begin_ns), end_ns)) or SE2() for stamp_ns, _ in messages]
    readings = [np.asarray(message.ranges, np.float64) for _, message in messages]
    readings = [
        np.where(ranges >= message.range_min, ranges, math.nan)
        for ranges, (_, message) in zip(readings, messages, strict=True)
    ]
    told_m = [float(message.range_max) for _, message in messages]
    told_m = [told if told > 0.0 else math.inf for told in told_m]
    places = np.array([(pose.x_m, pose.y_m) for pose in at])
    reaches_m = reaches(topic, readings, places, told_m, max_range_m, content.notes)
    fans: dict[tuple[Any, ...], NDArray[np.float64]] = {}
    tilted = 0
    for (stamp_ns, message), pose, ranges, reach_m in zip(
        messages, at, readings, reaches_m, strict=True
    ):
        mount = content.frames.lookup(base, frame, stamp_ns) or SE3()
        if abs(float(mount.rotation()[2, 2])) < _LEVEL:
            tilted += 1
            continue
        key = len(ranges), message.angle_min, message.angle_increment, mount.quaternion
        if key not in fans:
            fans[key] = _directions(message, len(ranges), mount)
        x_m, y_m, _ = mount.translation_m
        valid = valid_ranges(ranges, reach_m)
        scan = RangeScan(stamp_ns, fans[key], valid, reach_m, x_m, y_m)
        yield RecordedScan(scan, pose, reference.at(stamp_ns) if reference else None)
    if tilted:
        content.notes.append(f"{topic}: {tilted} of {len(messages)} scans are not level, left out")


def _directions(message: Any, count: int, mount: SE3) -> NDArray[np.float64]:
    """Return the directions of the beams of a scan in `base`, (n,) [rad]."""
    angles = message.angle_min + message.angle_increment * np.arange(count, dtype=np.float64)
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    x, y, _ = (beams @ mount.rotation().T).T
    return np.asarray(np.unwrap(np.arctan2(y, x)))


def _read(path: Path, options: ReadOptions) -> Recording:
    return read_ros_bag(path, options.max_range_m)


ROS_BAG: Final = LogFormat(
    "a ROS bag", is_ros_bag, _read, has_time_unit=False, in_folder="metadata.yaml, *.bag"
)
