"""Declaration of a format of recorded logs; `recorded_log.LOG_FORMATS` lists them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robotctl.model.recording import Recording


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options for reading a log; a format ignores those it does not need.

    Parameters
    ----------
    mrclam_robot
        Which robot of a MRCLAM folder; None: the one whose file is read, else robot 1.
    with_sonars
        Whether to read sonar ranges; in our own recordings this takes a while.
    time_unit
        Of the times in the log, one of `times.TIME_UNITS`; None: that of the format.
    max_range_m
        Lidar ranges from here on are no echoes [m]; None: as the log has it.
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
        With its article, for messages.
    matches
        Whether a file or folder, which exists, has this format. It reads the beginning of a file or
        the names in a folder, no more.
    read
        Reads what `matches`, through `Timeline` and `Odometry`, which leave out and note what does
        not fit; raises `LogFormatError` with file and line, or `OSError`.
    has_time_unit
        Whether times are numbers whose unit the user can give; False if the format fixes it.
    in_folder
        Files that identify a folder of this format, for messages; "" if it has no folders.
    """

    name: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, ReadOptions], Recording]
    has_time_unit: bool
    in_folder: str = ""
