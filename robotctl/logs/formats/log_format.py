"""Declaration of a format of recorded logs; `recorded_log.LOG_FORMATS` lists them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robotctl.model.recording import Recording


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options for reading a log; a format ignores those that it does not need.

    Parameters
    ----------
    mrclam_robot
        Robot of a MRCLAM folder; None: the one whose file is read, else robot 1.
    with_sonars
        Whether to read sonar ranges; in our own recordings this takes a while.
    time_unit
        Unit of the times in the log, one of `times.TIME_UNITS`; None: that of the format.
    max_range_m
        Lidar range from which on there is no echo [m]; None: as the log states.
    """

    mrclam_robot: int | None = None
    with_sonars: bool = True
    time_unit: str | None = None
    max_range_m: float | None = None


@dataclass(frozen=True, slots=True)
class LogFormat:
    """One format of recorded logs.

    Parameters
    ----------
    name
        Name with its article, for messages.
    matches
        Returns whether an existing file or folder has this format. It reads only the beginning of a
        file, or the names in a folder.
    read
        Reads what `matches`, through `Timeline` and `Odometry`, which drop and note inconsistent
        entries; raises `LogFormatError` with file and line, or `OSError`.
    has_time_unit
        Whether times are numbers with a unit that the user can give; False if the format fixes it.
    in_folder
        Files that identify a folder of this format, for messages; "" if it has no folders.
    """

    name: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, ReadOptions], Recording]
    has_time_unit: bool
    in_folder: str = ""
