"""Our own recordings as drives: the folder of `--record DIR`, or one `robot-0001.mcap` of it.

Odometry comes from the topic `control`, scans from the topic `lidar`, what the robot believed of
its place from `localisation`. Where the sonars sit and what they heard is in `control-0001.rec`
beside it; without that their ranges come from `control` too. The reference is `truth.tum` in the
folder, where there is one (its times are those of the log). All of a folder is taken for one robot.
JSON knows no infinity: a beam of the lidar without a range is inf there; a sonar without one has
heard no echo if its time is new, since the time of one that failed or is not there stays. See
docs/logs.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from mcap.records import Channel, Message
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from robotctl.model.localisation import LocalisationStatus
from robotctl.model.range_scan import RangeScan
from robotctl.model.recording import RecordedScan, RecordedSonar, Recording
from robotctl.model.se2 import SE2
from robotctl.model.sonar import SonarMount, SonarReading, listening_ns
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.messages import SonarFeedback
from robotctl.runtime.recorder import RecordError, Tick, read_record
from robotctl.runtime.sonar_news import SonarNews
from robotctl.telemetry.log_text import LogFormatError, in_order
from robotctl.telemetry.mcap_log import whole_records
from robotctl.telemetry.tum import read_tum

TRUTH: Final = "truth.tum"
_LATE_NS: Final = 500_000_000
_REACH_M: Final = 4.0
"""So far sonars listen that hear nothing [m]; their readings count when the sound was sent."""


class _Control(msgspec.Struct):
    """What is needed of a `ControlState`."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    sonar_m: list[float | None] = []
    sonar_stamp_ns: list[int] = []


class _Believed(msgspec.Struct):
    """What is needed of a `LocalisationState`: where the frame of the odometry lies in `world`."""

    status: int
    x_m: float
    y_m: float
    theta_rad: float


class _Robot(msgspec.Struct):
    """What is needed of a robot's configuration."""

    sonar: tuple[SonarMount, ...] = ()


class _Position(msgspec.Struct):
    x: float
    y: float


class _Pose(msgspec.Struct):
    position: _Position


class _Lidar(msgspec.Struct):
    """What is needed of a `foxglove.LaserScan`; ranges [m], None where nothing came back."""

    pose: _Pose
    start_angle: float
    end_angle: float
    max_range: float
    ranges: list[float | None]


@dataclass(slots=True)
class _Content:
    """What the messages of the files hold, with the times of the log [ns]."""

    control: list[tuple[int, _Control]] = field(default_factory=list)
    believed: list[tuple[int, _Believed]] = field(default_factory=list)
    lidar: list[tuple[int, _Lidar]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def is_mcap(path: Path) -> bool:
    """Return whether a file begins as MCAP does."""
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def mcap_files(folder: Path) -> list[Path]:
    """Return the logs of a folder that we recorded, in their order."""
    return sorted(folder.glob("robot-*.mcap"))


def read_own(path: Path) -> Recording:
    """Read all logs of a folder, or one log.

    Raises
    ------
    LogFormatError
        If a file is no MCAP file, a message is not as ours are, or no control state is in them.
    OSError
        If a file cannot be read.
    """
    folder = path if path.is_dir() else path.parent
    content = _Content()
    for file in mcap_files(path) if path.is_dir() else [path]:
        _take_in(file, content)
    if not content.control:
        raise LogFormatError(f"{path}: no message of the topic `control` in it")
    odometry = Trajectory(
        in_order(np.array([stamp_ns for stamp_ns, _ in content.control]))[0],
        np.array([(state.x_m, state.y_m, state.theta_rad) for _, state in content.control]),
    )
    mounts, frames = _control_records(folder, content.notes)
    truth = folder / TRUTH
    reference = read_tum(truth) if truth.exists() else None
    return Recording(
        name=path.name,
        scans=tuple(_scan(*each, odometry, reference, path) for each in content.lidar),
        odometry=odometry,
        reference=reference,
        believed=_believed(content.believed, odometry),
        sonars=tuple(_sonars(content.control, odometry, frames)),
        sonar_mounts=mounts,
        notes=tuple(content.notes),
    )


def _take_in(file: Path, content: _Content) -> None:
    """Take in the messages of one file."""
    if not is_mcap(file):
        raise LogFormatError(f"{file}: not an MCAP file")
    control, lidar = msgspec.json.Decoder(_Control), msgspec.json.Decoder(_Lidar)
    believed = msgspec.json.Decoder(_Believed)
    for topic, message in _messages(file, content.notes):
        try:
            if topic == "control":
                content.control.append((message.log_time, control.decode(message.data)))
            elif topic == "localisation":
                content.believed.append((message.log_time, believed.decode(message.data)))
            elif topic == "lidar":
                content.lidar.append((message.log_time, lidar.decode(message.data)))
        except msgspec.DecodeError as error:
            raise LogFormatError(
                f"{file}: topic {topic}, message at {message.log_time} ns: {error}"
            ) from error


def _messages(file: Path, notes: list[str]) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages up to the end of a file, or to where it was cut."""
    topics: dict[int, str] = {}
    with file.open("rb") as source:
        for record in whole_records(source):
            if record is None:
                notes.append(f"{file}: was cut, read up to the cut")
            elif isinstance(record, Channel) and record.message_encoding == MessageEncoding.JSON:
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id in topics:
                yield topics[record.channel_id], record


def _control_records(
    folder: Path, notes: list[str]
) -> tuple[tuple[SonarMount, ...], list[SonarFeedback]]:
    """Return where the sonars sit and all that came from them, by the records of the control loop.

    Both are empty where there is no such record.
    """
    mounts: tuple[SonarMount, ...] = ()
    frames: list[SonarFeedback] = []
    for path in sorted(folder.glob("control-*.rec")):
        try:
            with path.open("rb") as file:
                header, entries = read_record(file, str(path))
                mounts = msgspec.json.decode(header.robot_json, type=_Robot).sonar
                for entry in entries:
                    if isinstance(entry, Tick):
                        frames += entry.inputs.feedback.sonars
        except (RecordError, msgspec.DecodeError) as error:
            notes.append(f"the record of the control loop is not read: {error}")
    return mounts, frames


def _believed(states: Sequence[tuple[int, _Believed]], odometry: Trajectory) -> Trajectory | None:
    """Return where the robot believed to be while it was localised; None where it never was."""
    poses = {
        stamp_ns: SE2(state.x_m, state.y_m, state.theta_rad) @ at
        for stamp_ns, state in sorted(states, key=itemgetter(0))
        if state.status == LocalisationStatus.LOCALISED
        and (at := odometry.at(stamp_ns)) is not None
    }
    return Trajectory.of(poses, poses.values()) if poses else None


def _sonars(
    control: Sequence[tuple[int, _Control]],
    odometry: Trajectory,
    frames: Sequence[SonarFeedback],
) -> Iterator[RecordedSonar]:
    """Yield the readings with the times of the log.

    States repeat the last range of each sonar and may miss one that was soon followed by another,
    a missing echo most of all, which comes late. So the frames count where they were recorded.
    """
    begin_ns, end_ns = int(odometry.stamps_ns[0]), int(odometry.stamps_ns[-1])
    epoch_ns = control[0][0] - control[0][1].stamp_ns
    for sent_ns, heard in _of_frames(control, frames) if frames else _of_states(control):
        stamp_ns = sent_ns + epoch_ns
        if begin_ns - _LATE_NS <= stamp_ns <= end_ns + _LATE_NS:
            stamp_ns = min(max(stamp_ns, begin_ns), end_ns)
            yield RecordedSonar(SonarReading(stamp_ns, heard), odometry.at(stamp_ns) or SE2())


def _of_states(control: Sequence[tuple[int, _Control]]) -> Iterator[SonarReading]:
    """Yield what is new in each state, with the robot's times."""
    news = SonarNews(_REACH_M)
    for _, state in control:
        ranges_m = [math.inf if range_m is None else range_m for range_m in state.sonar_m]
        yield from news.take(state.stamp_ns, state.sonar_stamp_ns, ranges_m)


def _of_frames(
    control: Sequence[tuple[int, _Control]], frames: Sequence[SonarFeedback]
) -> Iterator[SonarReading]:
    """Yield the ranges of each frame, with the robot's times."""
    count = len(control[0][1].sonar_m)
    for frame in frames:
        heard = [math.nan] * count
        own = frame.ranges_m[: max(count - frame.first, 0)]
        heard[frame.first : frame.first + len(own)] = own
        if not all(map(math.isnan, heard)):
            sent_ns = frame.stamp_ns - listening_ns(heard, _REACH_M)
            yield SonarReading(sent_ns, tuple(heard))


def _ranges(values: Sequence[float | None], missing: float) -> NDArray[np.float64]:
    """Return ranges [m], with `missing` where the log has none."""
    return np.array([missing if value is None else value for value in values], dtype=np.float64)


def _scan(
    stamp_ns: int, lidar: _Lidar, odometry: Trajectory, reference: Trajectory | None, path: Path
) -> RecordedScan:
    """Return a scan with the poses at its time; before and after the odometry, its ends."""
    try:
        scan = RangeScan(
            stamp_ns,
            np.linspace(lidar.start_angle, lidar.end_angle, len(lidar.ranges)),
            _ranges(lidar.ranges, math.inf),
            lidar.max_range,
            lidar.pose.position.x,
            lidar.pose.position.y,
        )
    except ValueError as error:
        raise LogFormatError(f"{path}: topic lidar, scan at {stamp_ns} ns: {error}") from error
    inside_ns = min(max(stamp_ns, int(odometry.stamps_ns[0])), int(odometry.stamps_ns[-1]))
    return RecordedScan(
        scan, odometry.at(inside_ns) or SE2(), reference.at(stamp_ns) if reference else None
    )
