"""Recorded logs of every kind that is read, told apart by their content."""

from __future__ import annotations

import difflib
import math
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.errors import ConfigError
from robotctl.logs.formats.carmen_lines import KNOWN
from robotctl.logs.formats.carmen_log import read_carmen
from robotctl.logs.formats.lego_log import LINES as LEGO_LINES
from robotctl.logs.formats.lego_log import is_lego, read_lego
from robotctl.logs.formats.log_text import LogFormatError, first_words, hint
from robotctl.logs.formats.mrclam_log import is_mrclam, read_mrclam, robot_of
from robotctl.logs.formats.robotctl_log import is_mcap, mcap_files, read_own
from robotctl.logs.formats.ros_bag import is_ros_bag, read_ros_bag
from robotctl.logs.formats.times import check_pace, check_unit
from robotctl.model.recording import Recording

KINDS: Final = (
    "a CARMEN log, a MRCLAM folder, a log of the LEGO robot, a ROS bag, or a recording of "
    "robotctl (a folder of --record, or one robot-*.mcap of it)"
)
"""What is read, for messages."""

_OF_MAPS: Final = ("image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate")
_PICTURES: Final = (b"P2", b"P5", b"P6", b"\x89PNG", b"\xff\xd8\xff", b"BM")


def read_recording(
    path: Path,
    mrclam_robot: int | None = None,
    *,
    with_sonars: bool = True,
    time_unit: str | None = None,
    max_range_m: float | None = None,
) -> Recording:
    """Read a recorded drive of any kind.

    Parameters
    ----------
    path
        A file, plain or gzip, or a folder.
    mrclam_robot
        Which robot of a MRCLAM folder; by default the one whose file `path` is, else robot 1.
    with_sonars
        Whether what the sonars heard is wanted, which in a recording of ours takes a while to read.
    time_unit
        Of the times in the log, one of `log_times.TIME_UNITS`; None: that of its format, if the
        times can have it.
    max_range_m
        Ranges of the lidar from here on are no echoes [m]; None: as the log has it.

    Raises
    ------
    ConfigError
        If an option is none, or has no meaning for such a log.
    LogFormatError
        If it is of no kind that is read, damaged, or not there; the message names file and line,
        what was found and what is allowed.
    OSError
        If a file cannot be read.
    """
    check_unit(time_unit)
    if max_range_m is not None and not 0.0 < max_range_m < math.inf:
        raise ConfigError(f"--max-range {max_range_m:g}: a length above 0 m is needed")
    if not path.exists():
        raise LogFormatError(f"{path}: no such file or folder{_near(path)}")
    robot = robot_of(path)
    tells_unit = True
    if is_mrclam(path) if path.is_dir() else robot is not None:
        folder = path if path.is_dir() else path.parent
        recording = read_mrclam(folder, mrclam_robot or robot or 1, time_unit or "s")
    elif not (path.is_dir() and mcap_files(path)) and is_ros_bag(path):
        tells_unit = False
        recording = read_ros_bag(path, max_range_m)
    elif mcap_files(path) if path.is_dir() else is_mcap(path):
        tells_unit = False
        recording = read_own(path, with_sonars=with_sonars)
    elif is_lego(path) if path.is_dir() else _first_word(path) in LEGO_LINES:
        recording = read_lego(path, time_unit or "ms")
    elif path.is_dir():
        raise LogFormatError(
            f"{path}: a folder with neither RobotN_Odometry.dat, robot-*.mcap nor *_motors.txt; "
            f"needed is {KINDS}"
        )
    else:
        _check_carmen(path)
        recording = read_carmen(path, time_unit or "s", max_range_m)
    if time_unit is not None and not tells_unit:
        raise ConfigError(f"--time-unit {time_unit}: the times of {path} are nanoseconds")
    if time_unit is None:
        check_pace(recording, tells_unit)
    return recording if max_range_m is None else _limited(recording, max_range_m)


def _check_carmen(path: Path) -> None:
    """Refuse a file that is no CARMEN log, and so nothing that is read."""
    word = _first_word(path)
    if word not in KNOWN:
        raise LogFormatError(f"{path}: {_found(path, word)}; needed is {KINDS}")


def is_log(path: Path) -> bool:
    """Return whether a file is a recorded log, by its beginning."""
    try:
        word = _first_word(path)
        return is_mcap(path) or is_ros_bag(path) or word in KNOWN or word in LEGO_LINES
    except (LogFormatError, OSError):
        return False


def _found(path: Path, word: str) -> str:
    """Return what a file is that is no log, by its first word."""
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
    """Return a recording whose lidar reaches so far."""
    scans = []
    for entry in recording.scans:
        ranges = entry.scan.ranges_m
        ranges = np.where(ranges >= max_range_m, math.inf, ranges)
        scans.append(
            replace(entry, scan=replace(entry.scan, ranges_m=ranges, max_range_m=max_range_m))
        )
    return replace(recording, scans=tuple(scans))


def _first_word(path: Path) -> str:
    """Return the first word of the first line that is no comment."""
    for line in first_words(path).splitlines():
        words = line.split()
        if words and not words[0].startswith("#"):
            return words[0]
    return ""


def _near(path: Path) -> str:
    """Return a hint at the entry of the folder that is named most like it."""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist"
    names = [each.name for each in path.parent.iterdir()]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f'; did you mean "{near[0]}"?' if near else ""
