"""Our own recordings as drives: the folder of `--record DIR`, or one `robot-0001.mcap` of it.

Odometry comes from the topic `control`, scans from the topics `lidar` and `camera`, what the robot
believed of its place from `localisation`. Sonar mounting and readings are in `control-0001.rec`
beside it; without that their ranges come from `control` too (`own_sonars`). The reference is
`truth-0001.tum` in the folder, of the run whose logs begin with `robot-0001.mcap`, where there is
one (its times are those of the log); older versions called it `truth.tum`. A folder is assumed to
hold one robot. Logs of older versions do not distinguish a missing echo from a failed sonar: there
a reading without a range is a missing echo if its time is new, since the time of one that failed or
is not there stays.
See docs/logs.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
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

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.robotctl_messages import (
    LoggedBelief,
    LoggedScan,
    LoggedState,
    LoggedView,
    logged_belief,
    logged_scan,
    logged_state,
    logged_view,
)
from robotctl.logs.formats.robotctl_sonars import OwnSonars, own_sonars
from robotctl.logs.formats.ros_bag import is_ros_bag
from robotctl.logs.formats.times import in_order
from robotctl.logs.formats.tum import read_tum
from robotctl.logs.mcap.records import Gap
from robotctl.logs.mcap.recovery import log_records
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, RecordedSonar, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.trajectory import Trajectory

TRUTH: Final = "truth.tum"
"""The truth in a folder of an older version, which kept that of its last run."""

_NUMBER: Final = re.compile(r"(?:robot|truth)-(\d+)\.(?:mcap|tum)")
_LATE_NS: Final = 500_000_000


@dataclass(slots=True)
class _Content:
    """Content of the files' messages, with the times of the log [ns]."""

    control: list[tuple[int, LoggedState]] = field(default_factory=list)
    believed: list[tuple[int, LoggedBelief]] = field(default_factory=list)
    lidar: list[tuple[int, LoggedScan]] = field(default_factory=list)
    views: list[tuple[int, LoggedView]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def is_mcap(path: Path) -> bool:
    """Return whether a file begins as MCAP does."""
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def mcap_files(folder: Path) -> list[Path]:
    """Return the logs of a folder that we recorded, in their order."""
    return sorted(folder.glob("robot-*.mcap"))


def _folder(path: Path) -> Path:
    """Return the folder of a log, which may be that folder."""
    return path if path.is_dir() else path.parent


def truth_files(path: Path) -> list[Path]:
    """Return where the truth of a log of ours is: of all runs of a folder, or of that of one file.

    A run's truth has the number of its first log. It is empty if the run did not come to its
    end: then the robot's place is unknown.
    """
    folder = _folder(path)
    truths = sorted([*folder.glob(TRUTH), *folder.glob("truth-[0-9]*.tum")], key=_number)
    if not path.is_dir():
        truths = [each for each in truths if _number(each) <= _number(path)][-1:]
    return [each for each in truths if each.stat().st_size]


def _number(path: Path) -> int:
    """Return the number in the name of a file; 0 if it has none."""
    match = _NUMBER.fullmatch(path.name)
    return int(match[1]) if match else 0


def read_own(path: Path, *, with_sonars: bool = True) -> Recording:
    """Read all logs of a folder, or one log.

    Parameters
    ----------
    path
        Folder or file.
    with_sonars
        Whether to read sonar ranges; reading the records for them takes a while.

    Raises
    ------
    LogFormatError
        If a file is no MCAP file, a message is not as ours are, no control state is in them, or
        they are of robots with different sonars.
    OSError
        If a file cannot be read.
    """
    content = _Content()
    for file in mcap_files(path) if path.is_dir() else [path]:
        _take_in(file, content)
    if not content.control:
        raise LogFormatError(f"{path}: no message of the topic `control` in it")
    odometry, in_time = _odometry(content)
    sonars = own_sonars(_of_one_robot(in_time, path), _folder(path)) if with_sonars else OwnSonars()
    reference = _reference(path, odometry)
    return Recording(
        name=path.name,
        scans=tuple(_scan(*each, odometry, reference, path) for each in content.lidar),
        odometry=odometry,
        gyro_turns_rad=_gyro_turns_rad(content),
        reference=reference,
        believed=_believed(content.believed, odometry),
        sonars=tuple(_while_logged(sonars.readings, odometry)),
        sonar_mounts=sonars.mounts,
        views=tuple(_view(*each, odometry, reference, path) for each in content.views),
        notes=(*content.notes, *sonars.notes),
    )


def _reference(path: Path, odometry: Trajectory) -> Trajectory | None:
    """Return the truth of the time of the log; None if there is none."""
    truths = [read_tum(each) for each in truth_files(path)]
    truths = [
        each
        for each in truths
        if each.stamps_ns[0] <= odometry.stamps_ns[-1]
        and odometry.stamps_ns[0] <= each.stamps_ns[-1]
    ]
    if not truths:
        return None
    stamps_ns, _ = in_order(np.concatenate([each.stamps_ns for each in truths]))
    return Trajectory(stamps_ns, np.concatenate([each.poses for each in truths]))


def _take_in(file: Path, content: _Content) -> None:
    """Take in the messages of one file."""
    for topic, message in json_messages(file, content.notes):
        try:
            if topic == "control":
                content.control.append((message.log_time, logged_state(message.data)))
            elif topic == "localisation":
                content.believed.append((message.log_time, logged_belief(message.data)))
            elif topic == "lidar":
                content.lidar.append((message.log_time, logged_scan(message.data)))
            elif topic == "camera" and (view := logged_view(message.data)) is not None:
                content.views.append((message.log_time, view))
        except msgspec.DecodeError as error:
            raise LogFormatError(
                f"{file}: topic {topic}, message at {message.log_time} ns: {error}"
            ) from error


def json_messages(file: Path, notes: list[str]) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages up to the end of a file, past places that are damaged.

    Omissions are noted, one sentence each.

    Raises
    ------
    LogFormatError
        If it is no MCAP file.
    """
    if not is_mcap(file):
        raise LogFormatError(f"{file}: not an MCAP file")
    topics: dict[int, str] = {}
    with file.open("rb") as source:
        for record in log_records(source):
            if isinstance(record, Gap):
                notes.append(
                    f"{file}: was cut short, read up to there"
                    if record.is_cut
                    else f"{file}: damaged at byte {record.begin}, {record.length} bytes left out"
                )
            elif isinstance(record, Channel) and record.message_encoding == MessageEncoding.JSON:
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id in topics:
                yield topics[record.channel_id], record


def _odometry(content: _Content) -> tuple[Trajectory, list[tuple[int, LoggedState]]]:
    """Return where the odometry was, and the states whose times do not go back."""
    stamps_ns, moved = in_order(np.array([log_ns for log_ns, _ in content.control]))
    if moved:
        content.notes.append(
            f"the times of {moved} of {len(stamps_ns)} control states go back, held: a clock was "
            "set, or the folder has several runs; what their sonars heard is left out"
        )
    poses = [state.T_odom_base for _, state in content.control]
    in_time = [
        each for each, stamp_ns in zip(content.control, stamps_ns, strict=True)
        if each[0] == stamp_ns
    ]  # fmt: skip
    rows = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses])
    return Trajectory(stamps_ns, rows), in_time


def _gyro_turns_rad(content: _Content) -> NDArray[np.float64]:
    """Return by how much the gyro has turned the odometry, (n,) [rad]; (0,) without an IMU."""
    found = [state.corrected_rad for _, state in content.control]
    if not any(found):
        return np.empty(0)
    last_rad, turns_rad = 0.0, []
    for corrected_rad in found:
        last_rad = last_rad if corrected_rad is None else corrected_rad
        turns_rad.append(last_rad)
    return np.array(turns_rad)


def _of_one_robot(
    states: Sequence[tuple[int, LoggedState]], path: Path
) -> Sequence[tuple[int, LoggedState]]:
    """Return the states if all have as many sonars."""
    counts = sorted({len(state.sonar_m) for _, state in states})
    if len(counts) > 1:
        raise LogFormatError(
            f"{path}: topic control: states with {' and '.join(map(str, counts))} sonars, of "
            "different robots; read the logs of each by themselves"
        )
    return states


def _believed(
    states: Sequence[tuple[int, LoggedBelief]], odometry: Trajectory
) -> Trajectory | None:
    """Return where the robot believed to be while it was localised; None if it never was."""
    poses = {
        stamp_ns: state.T_world_odom @ at
        for stamp_ns, state in sorted(states, key=itemgetter(0))
        if state.status == LocalisationStatus.LOCALISED
        and (at := odometry.at(stamp_ns)) is not None
    }
    return Trajectory.of(poses, poses.values()) if poses else None


def _while_logged(
    readings: Iterable[SonarReading], odometry: Trajectory
) -> Iterator[RecordedSonar]:
    """Yield the readings within the log's time, with the odometry of their time."""
    begin_ns, end_ns = int(odometry.stamps_ns[0]), int(odometry.stamps_ns[-1])
    for sent_ns, heard in readings:
        if begin_ns - _LATE_NS <= sent_ns <= end_ns + _LATE_NS:
            stamp_ns = min(max(sent_ns, begin_ns), end_ns)
            yield RecordedSonar(SonarReading(stamp_ns, heard), odometry.at(stamp_ns) or SE2())


def _scan(
    stamp_ns: int, lidar: LoggedScan, odometry: Trajectory, reference: Trajectory | None, path: Path
) -> RecordedScan:
    """Return a scan of the lidar with the poses at its time."""
    try:
        scan = RangeScan(
            stamp_ns,
            np.linspace(lidar.first_rad, lidar.last_rad, len(lidar.ranges_m)),
            np.array(lidar.ranges_m, dtype=np.float64),
            lidar.max_range_m,
            lidar.x_m,
            lidar.y_m,
        )
    except ValueError as error:
        raise LogFormatError(f"{path}: topic lidar, scan at {stamp_ns} ns: {error}") from error
    return _placed(scan, odometry, reference)


def _view(
    stamp_ns: int, view: LoggedView, odometry: Trajectory, reference: Trajectory | None, path: Path
) -> RecordedScan:
    """Return a view of the camera with the poses at its time."""
    angles, ranges, sigmas = np.array(view.beams, dtype=np.float64).reshape(-1, 3).T
    try:
        scan = RangeScan(stamp_ns, angles, ranges, view.max_range_m, view.x_m, view.y_m, sigmas)
    except ValueError as error:
        raise LogFormatError(f"{path}: topic camera, view at {stamp_ns} ns: {error}") from error
    return _placed(scan, odometry, reference)


def _placed(scan: RangeScan, odometry: Trajectory, reference: Trajectory | None) -> RecordedScan:
    """Return a scan with the poses at its time; before and after the odometry, its ends."""
    inside_ns = min(max(scan.stamp_ns, int(odometry.stamps_ns[0])), int(odometry.stamps_ns[-1]))
    return RecordedScan(
        scan, odometry.at(inside_ns) or SE2(), reference.at(scan.stamp_ns) if reference else None
    )


def _matches(path: Path) -> bool:
    if path.is_dir():
        return bool(mcap_files(path))
    return is_mcap(path) and not is_ros_bag(path)


def _read(path: Path, options: ReadOptions) -> Recording:
    return read_own(path, with_sonars=options.with_sonars)


ROBOTCTL: Final = LogFormat(
    "a recording of robotctl (a folder of --record, or one robot-*.mcap of it)",
    _matches,
    _read,
    has_time_unit=False,
    in_folder="robot-*.mcap",
)
