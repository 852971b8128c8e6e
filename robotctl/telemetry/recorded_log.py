"""Recorded logs of every kind that is read, told apart by their content."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Final

from robotctl.model.recording import Recording
from robotctl.telemetry.carmen_lines import KNOWN
from robotctl.telemetry.carmen_log import read_carmen
from robotctl.telemetry.lego_log import LINES as LEGO_LINES
from robotctl.telemetry.lego_log import is_lego, read_lego
from robotctl.telemetry.log_text import LogFormatError, first_words
from robotctl.telemetry.mrclam_log import is_mrclam, read_mrclam, robot_of
from robotctl.telemetry.own_log import is_mcap, mcap_files, read_own

KINDS: Final = (
    "a CARMEN log, a MRCLAM folder, a log of the LEGO robot, or a recording of robotctl "
    "(a folder of --record, or one robot-*.mcap of it)"
)
"""What is read, for messages."""


def read_recording(
    path: Path, mrclam_robot: int | None = None, *, with_sonars: bool = True
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

    Raises
    ------
    LogFormatError
        If it is of no kind that is read, damaged, or not there; the message names file and line,
        what was found and what is allowed.
    OSError
        If a file cannot be read.
    """
    if not path.exists():
        raise LogFormatError(f"{path}: no such file or folder{_near(path)}")
    if path.is_dir():
        return _read_folder(path, mrclam_robot, with_sonars=with_sonars)
    if is_mcap(path):
        return read_own(path, with_sonars=with_sonars)
    robot = robot_of(path)
    if robot is not None:
        return read_mrclam(path.parent, mrclam_robot or robot)
    word = _first_word(path)
    if word in KNOWN:
        return read_carmen(path)
    if word in LEGO_LINES:
        return read_lego(path)
    found = f"the first line begins with {word[:24]!r}" if word else "no text in it"
    raise LogFormatError(f"{path}: {found}; needed is {KINDS}")


def _read_folder(folder: Path, mrclam_robot: int | None, *, with_sonars: bool) -> Recording:
    """Read a folder, whose kind the names of its files tell."""
    if is_mrclam(folder):
        return read_mrclam(folder, mrclam_robot or 1)
    if mcap_files(folder):
        return read_own(folder, with_sonars=with_sonars)
    if is_lego(folder):
        return read_lego(folder)
    raise LogFormatError(
        f"{folder}: a folder with neither RobotN_Odometry.dat, robot-*.mcap nor *_motors.txt; "
        f"needed is {KINDS}"
    )


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
