"""Recorded logs of all formats, recognised by content."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.errors import ConfigError
from robotctl.estimation.ranging.unwinding import unwound
from robotctl.logs.formats.carmen_log import CARMEN
from robotctl.logs.formats.keyframes_log import KEYFRAMES
from robotctl.logs.formats.lego_log import LEGO
from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError, first_word, hint
from robotctl.logs.formats.mrclam_log import MRCLAM
from robotctl.logs.formats.robotctl_log import ROBOTCTL
from robotctl.logs.formats.ros_bag import ROS_BAG
from robotctl.logs.formats.times import check_pace, check_span, check_unit
from robotctl.logs.formats.tum import TUM
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.trajectory import Trajectory

LOG_FORMATS: tuple[LogFormat, ...] = (
    CARMEN,
    MRCLAM,
    ROBOTCTL,  # before ROS bags: its folders may contain files like these
    ROS_BAG,
    LEGO,
    KEYFRAMES,
    TUM,
)
"""All formats; the first that matches reads. A new one is a file, and a line here."""

_MAX_SWEEP_S: Final = 1.0
_OF_MAPS: Final = ("image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate")
_PICTURES: Final = (b"P2", b"P5", b"P6", b"\x89PNG", b"\xff\xd8\xff", b"BM")


def read_recording(
    path: Path,
    mrclam_robot: int | None = None,
    *,
    with_sonars: bool = True,
    time_unit: str | None = None,
    max_range_m: float | None = None,
    sweep_s: float | None = None,
) -> Recording:
    """Read a recorded drive of any format in `LOG_FORMATS`.

    Parameters
    ----------
    path
        A file, plain or gzip, or a folder.
    mrclam_robot
        Robot of a MRCLAM folder; by default the one whose file `path` is, else robot 1.
    with_sonars
        Whether to read sonar ranges; in our own recordings this takes a while.
    time_unit
        Unit of the times in the log, one of `times.TIME_UNITS`; None: that of its format, if
        plausible.
    max_range_m
        Lidar range from which on there is no echo [m]; None: as the log states.
    sweep_s
        Time from a scan's first beam to its last, as of `RangeScan` [s]; None: as the log states.
        Scans are told as from the place of their last beam, where the odometry says it.

    Raises
    ------
    ConfigError
        If an option is invalid, or has no meaning for such a log.
    LogFormatError
        If its format is unknown, or it has no motion, is damaged or missing; the message names file
        and line, what was found and what is allowed.
    OSError
        If a file cannot be read.
    """
    check_unit(time_unit)
    if max_range_m is not None and not 0.0 < max_range_m < math.inf:
        raise ConfigError(f"--max-range {max_range_m:g}: a length above 0 m is needed")
    kind = _format_of(path)
    recording = kind.read(path, ReadOptions(mrclam_robot, with_sonars, time_unit, max_range_m))
    if recording.odometry is None and not len(recording.twists):
        others = [each for each in LOG_FORMATS if each is not kind]
        raise LogFormatError(
            f"{path}: {kind.name}, which tells no motion of the robot; needed is {_named(others)}"
        )
    if time_unit is not None and not kind.has_time_unit:
        raise ConfigError(f"--time-unit {time_unit}: the times of {path} are nanoseconds")
    if time_unit is None:
        check_pace(recording, kind.has_time_unit)
    check_span(recording)
    if max_range_m is not None:
        recording = _limited(recording, max_range_m)
    return _unwound(recording, sweep_s)


def read_reference(path: Path) -> tuple[Trajectory, bool]:
    """Read the reference of a trajectory or of a log that has one; return whether it has headings.

    Raises
    ------
    LogFormatError
        As for `read_recording`, or if there is no reference in it.
    OSError
        If a file cannot be read.
    """
    recording = _format_of(path).read(path, ReadOptions(with_sonars=False))
    if recording.reference is None:
        raise LogFormatError(f"{path}: no reference in it; {TUM.name} is one")
    return recording.reference, recording.reference_has_heading


def _format_of(path: Path) -> LogFormat:
    """Return the format of a file or folder; raises `LogFormatError` if none matches."""
    if not path.exists():
        raise LogFormatError(f"{path}: no such file or folder{_near(path)}")
    for kind in LOG_FORMATS:
        if kind.matches(path):
            return kind
    if path.is_dir():
        names = [kind.in_folder for kind in LOG_FORMATS if kind.in_folder]
        found = f"a folder with neither {', '.join(names[:-1])} nor {names[-1]}"
    else:
        found = _found(path, first_word(path))
    raise LogFormatError(f"{path}: {found}; needed is {_named(LOG_FORMATS)}")


def _named(formats: Sequence[LogFormat]) -> str:
    """Return the names of formats as a choice, for messages."""
    names = [each.name for each in formats]
    return f"{', '.join(names[:-1])}, or {names[-1]}"


def is_log(path: Path) -> bool:
    """Return whether a file or folder is a recorded log, by its beginning."""
    try:
        return any(kind.matches(path) for kind in LOG_FORMATS)
    except (LogFormatError, OSError):
        return False


def _found(path: Path, word: str) -> str:
    """Return the kind of a file that is not a log, by its first word."""
    if word.removesuffix(":") in _OF_MAPS:
        return "a ROS map, which is for --map"
    with path.open("rb") as file:
        if file.read(8).startswith(_PICTURES):
            return "a picture"
    if word.startswith("["):
        return "a TOML file, as worlds, missions and robots are"
    if not word:
        return "no text in it"
    return f"the first line begins with {word[:24]!r}{hint(word)}"


def _limited(recording: Recording, max_range_m: float) -> Recording:
    """Return a recording with another maximum lidar range."""
    scans = []
    for entry in recording.scans:
        ranges = entry.scan.ranges_m
        ranges = np.where(ranges >= max_range_m, math.inf, ranges)
        scans.append(
            replace(entry, scan=replace(entry.scan, ranges_m=ranges, max_range_m=max_range_m))
        )
    return replace(recording, scans=tuple(scans))


def _unwound(recording: Recording, sweep_s: float | None) -> Recording:
    """Return a recording whose scans are as from one place, if its odometry is not its reference.

    Without odometry, SLAM unwinds them by the motion that it finds.
    """
    scans = recording.scans
    if sweep_s is not None:
        if not abs(sweep_s) <= _MAX_SWEEP_S:
            raise ConfigError(f"--sweep {sweep_s:g}: at most {_MAX_SWEEP_S:g} s are allowed")
        scans = tuple(replace(each, scan=replace(each.scan, sweep_s=sweep_s)) for each in scans)
    if not any(each.scan.sweep_s for each in scans):
        return recording
    odometry = recording.odometry
    if odometry is not None and has_odometry(scans):
        scans = tuple(replace(each, scan=unwound(each.scan, odometry.at)) for each in scans)
    return replace(recording, scans=scans)


def has_odometry(scans: Sequence[RecordedScan]) -> bool:
    """Return whether the odometry of scans is any, and not their reference again."""
    return any(each.reference is None or each.odometry != each.reference for each in scans)


def _near(path: Path) -> str:
    """Return a hint at the folder's entry with the most similar name."""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist"
    names = [each.name for each in path.parent.iterdir()]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f'; did you mean "{near[0]}"?' if near else ""
