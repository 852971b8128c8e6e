"""Our own recordings as drives: the folder of `--record DIR`, or one `robot-0001.mcap` of it.

Odometry comes from the topic `control`, scans from the topics `lidar` and `camera`, the robot's
estimated pose from `localisation`. Sonar mounting and readings are in `control-0001.rec` beside it;
without that their ranges come from `control` too (`own_sonars`). The reference is `truth-0001.tum`
in the folder, if present, for the run whose logs begin with `robot-0001.mcap` (with the times of
the log). A folder is assumed to hold one robot. See docs/logs.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from mcap.records import Channel, Message
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.placing import Odometry
from robotctl.logs.formats.robotctl_messages import (
    LoggedScan,
    LoggedState,
    LoggedView,
    is_outdated,
    logged_belief,
    logged_scan,
    logged_state,
    logged_view,
)
from robotctl.logs.formats.robotctl_sonars import OwnSonars, own_sonars
from robotctl.logs.formats.ros_messages import is_ros_bag
from robotctl.logs.formats.timeline import Series, Timeline
from robotctl.logs.formats.tum import read_tum
from robotctl.logs.mcap.records import Gap
from robotctl.logs.mcap.recovery import log_records
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.recording import RecordedScan, RecordedSonar, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.trajectory import Trajectory

_NUMBER: Final = re.compile(r"(?:robot|truth)-(\d+)\.(?:mcap|tum)")
_STATES, _BELIEFS = "control states", "states of the localiser"
_LIDAR, _CAMERA = "scans of the lidar", "views of the camera"
_SOURCES: Final[dict[str, tuple[str, Callable[[bytes, int], object]]]] = {
    "control": (_STATES, lambda data, _: logged_state(data)),
    "localisation": (_BELIEFS, lambda data, _: logged_belief(data)),
    "lidar": (_LIDAR, lambda data, stamp_ns: _scan(stamp_ns, logged_scan(data))),
    "camera": (_CAMERA, lambda data, stamp_ns: _view(stamp_ns, logged_view(data))),
}
"""Message type and reader of each topic."""


class _State(NamedTuple):
    """A control state with its time in the log [ns] and its file."""

    log_ns: int
    state: LoggedState
    file: Path


def is_mcap(path: Path) -> bool:
    """Return whether a file begins as MCAP."""
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def mcap_files(folder: Path) -> list[Path]:
    """Return our own logs of a folder, in their order."""
    return sorted(folder.glob("robot-*.mcap"))


def _folder(path: Path) -> Path:
    """Return the folder of a log, or the path itself if a folder."""
    return path if path.is_dir() else path.parent


def truth_files(path: Path) -> list[Path]:
    """Return the truth files of our own logs: of all runs of a folder, or of one file's run.

    A run's truth has the number of its first log. It is empty if the run was interrupted: then the
    true pose is unknown.
    """
    folder = _folder(path)
    truths = sorted(folder.glob("truth-[0-9]*.tum"), key=_number)
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
        If a file is not MCAP, there is no control state, or the robots have different sonars.
    OSError
        If a file cannot be read.
    """
    notes: list[str] = []
    timeline: Timeline[str] = Timeline(notes)
    for file in mcap_files(path) if path.is_dir() else [path]:
        _take_in(file, timeline, notes)
    found = timeline.settled()
    states: list[_State] = found[_STATES].values if _STATES in found else []
    if not states:
        raise LogFormatError(
            "; ".join([f"{path}: no message of the topic `control` in it", *notes])
        )
    odometry = _odometry(path, found[_STATES], notes)
    known = odometry.trajectory
    in_time = [
        (each.log_ns, each.state) for at, each in found[_STATES].with_times() if at == each.log_ns
    ]
    sonars = own_sonars(_of_one_robot(in_time, path), _folder(path)) if with_sonars else OwnSonars()
    reference = _reference(known, {each.file for each in states})
    return Recording(
        name=path.name,
        scans=_of_lidars(found, odometry, reference),
        odometry=known,
        gyro_turns_rad=_gyro_turns_rad([states[row] for row in odometry.rows.tolist()]),
        reference=reference,
        believed=_believed(found.get(_BELIEFS), known),
        sonars=_placed_readings(sonars.readings, odometry),
        sonar_mounts=sonars.mounts,
        views=_placed(found.get(_CAMERA), odometry, reference),
        notes=(*notes, *sonars.notes),
    )


def _reference(odometry: Trajectory, files: Collection[Path]) -> Trajectory | None:
    """Return the truth of the runs of some logs within the odometry's time; None without one."""
    there = sorted({truth for each in files for truth in truth_files(each)[-1:]}, key=_number)
    begin_ns, end_ns = odometry.stamps_ns[[0, -1]].tolist()
    truths = [
        each
        for each in map(read_tum, there)
        if each.stamps_ns[0] <= end_ns and begin_ns <= each.stamps_ns[-1]
    ]
    if not truths:
        return None
    stamps_ns = np.concatenate([each.stamps_ns for each in truths])
    return Trajectory(
        np.maximum.accumulate(stamps_ns), np.concatenate([each.poses for each in truths])
    )


def _take_in(file: Path, timeline: Timeline[str], notes: list[str]) -> None:
    """Add the messages of one file."""
    for topic, message in json_messages(file, notes):
        if topic not in _SOURCES:
            continue
        source, read = _SOURCES[topic]
        try:
            value = read(message.data, message.log_time)
        except (msgspec.DecodeError, ValueError) as error:
            if topic == "control" and is_outdated(message.data):
                raise LogFormatError(
                    f"{file}: written by a version before 0.1.0, whose poses have another form; "
                    "logs of 0.1.0 and later can be read"
                ) from error
            timeline.leave_out(source, message.log_time, str(error))
            continue
        if isinstance(value, LoggedState):
            value = _State(message.log_time, value, file)
        if isinstance(value, RangeScan) and value.name:
            source = f"{source} {value.name}"  # each has an order of its own
        if value is not None:
            timeline.add(source, message.log_time, value, message.data)


def json_messages(file: Path, notes: list[str]) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages up to the end of a file, skipping damage.

    Omissions are noted, one sentence each.

    Raises
    ------
    LogFormatError
        If it is not an MCAP file.
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


def _odometry(path: Path, states: Series, notes: list[str]) -> Odometry:
    """Return the odometry."""
    poses = [each.state.T_odom_base for each in states.values]
    rows = [(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]
    epochs_ns = np.array([each.state.odom_epoch_ns for each in states.values])
    begins = np.append(False, np.diff(epochs_ns) != 0)
    return Odometry(path, replace(states, what="poses of the odometry", values=rows), notes, begins)


def _gyro_turns_rad(states: Sequence[_State]) -> NDArray[np.float64]:
    """Return the gyro's contribution to the odometry's turn, (n,) [rad]; (0,) without an IMU."""
    found = [each.state.corrected_rad for each in states]
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
    """Return the states if all have the same number of sonars."""
    counts = sorted({len(state.sonar_m) for _, state in states})
    if len(counts) > 1:
        raise LogFormatError(
            f"{path}: topic control: states with {' and '.join(map(str, counts))} sonars, of "
            "different robots; read the logs of each by themselves"
        )
    return states


def _believed(states: Series | None, odometry: Trajectory) -> Trajectory | None:
    """Return the robot's own pose estimate while it was localised; None if it never was."""
    poses = {
        stamp_ns: state.T_world_odom @ at
        for stamp_ns, state in ([] if states is None else states.with_times())
        if state.status == LocalisationStatus.LOCALISED
        and (at := odometry.at(stamp_ns)) is not None
    }
    return Trajectory.of(poses, poses.values()) if poses else None


def _placed_readings(
    readings: Sequence[SonarReading], odometry: Odometry
) -> tuple[RecordedSonar, ...]:
    """Return the readings within the log's time; the records beside it have more."""
    begin_ns, end_ns = odometry.trajectory.stamps_ns[[0, -1]].tolist()
    inside = [each for each in readings if begin_ns <= each.stamp_ns <= end_ns]
    stamps_ns = np.array([each.stamp_ns for each in inside], np.int64)
    series = Series(
        "sonar readings", stamps_ns, np.empty(0, np.int64), inside, np.zeros(len(inside), bool)
    )
    return tuple(RecordedSonar(reading, pose) for _, reading, pose in odometry.place(series))


def _scan(stamp_ns: int, lidar: LoggedScan) -> RangeScan:
    """Return a scan of the lidar; raises `ValueError` if invalid."""
    return RangeScan(
        stamp_ns,
        np.linspace(lidar.first_rad, lidar.last_rad, len(lidar.ranges_m)),
        np.array(lidar.ranges_m, dtype=np.float64),
        lidar.max_range_m,
        lidar.x_m,
        lidar.y_m,
        name=lidar.name,
        sweep_s=lidar.sweep_s,
    )


def _view(stamp_ns: int, view: LoggedView | None) -> RangeScan | None:
    """Return a view of the camera, None in trouble; raises `ValueError` if invalid."""
    if view is None:
        return None
    angles, ranges, sigmas = np.array(view.beams, dtype=np.float64).reshape(-1, 3).T
    return RangeScan(stamp_ns, angles, ranges, view.max_range_m, view.x_m, view.y_m, sigmas)


def _of_lidars(
    found: Mapping[str, Series], odometry: Odometry, reference: Trajectory | None
) -> tuple[RecordedScan, ...]:
    """Return the scans of all lidars in the order of their times."""
    lidars = [series for source, series in found.items() if source.startswith(_LIDAR)]
    scans = [each for series in lidars for each in _placed(series, odometry, reference)]
    return tuple(sorted(scans, key=lambda each: each.scan.stamp_ns))


def _placed(
    scans: Series | None, odometry: Odometry, reference: Trajectory | None
) -> tuple[RecordedScan, ...]:
    """Return scans with the poses at their times."""
    placed = [] if scans is None else odometry.place(scans)
    return tuple(
        RecordedScan(
            replace(scan, stamp_ns=stamp_ns), pose, reference.at(stamp_ns) if reference else None
        )
        for stamp_ns, scan, pose in placed
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
