"""Logs of the LEGO robot of Claus Brenner's lecture on SLAM (Leibniz University Hannover).

Every line begins with the letter of its kind, lengths are mm and times ms of one clock:
`M t l . . . r ...` cumulative ticks of the left (third word) and right wheel (seventh);
`S t n r1 ... rn` a scan; `P t x y` where an overhead camera sees the robot, without a heading;
`L C x y diameter` a cylinder that is a landmark. The kinds may be in one file or in several:
`robot4_motors.txt`, `robot4_scan.txt`, `robot4_reference.txt`, `robot_arena_landmarks.txt`.

The robot's constants are the lecture's: beam i looks at (i - 330) pi/512 - 4 deg (the scanner is
mounted turned; against the cylinders of the arena, -3 to -6 deg fits best), 30 mm before the axle.
Readings to 20 mm are error codes of the scanner, a Hokuyo that reaches 4.095 m. Odometry follows
from 0.349 mm a tick and 173 mm between the wheels, nominal values: `wheel_ticks` has the counts.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import (
    LogFormatError,
    LogText,
    first_word,
    integer,
    numbers,
    read_text,
)
from robotctl.logs.formats.placing import Odometry, trajectory
from robotctl.logs.formats.timeline import Series, Timeline
from robotctl.logs.formats.times import going_on, note_pairs
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory

TICK_M: Final = 0.349e-3
TRACK_WIDTH_M: Final = 0.173
SCANNER_X_M: Final = 0.03
SCANNER_TURN_RAD: Final = math.radians(-4.0)
BEAM_STEP_RAD: Final = math.pi / 512.0
FORWARD_BEAM: Final = 330
REACH_M: Final = 4.095
_ERROR_MM: Final = 20
_NEEDED: Final = {"M": 7, "P": 4, "S": 3, "L": 4}
LINES: Final = tuple(_NEEDED)
"""Kinds of lines."""

_PARTS: Final = ("motors", "scan", "reference")


class _Line(NamedTuple):
    """The numbers of a line, and its position."""

    text: LogText
    number: int
    values: list[float]


_Lines: TypeAlias = dict[str, list[_Line]]


def is_lego(folder: Path) -> bool:
    """Return whether a folder holds such a recording, by the names of its files."""
    return any(_part(path) == "motors" for path in folder.iterdir())


def lego_files(path: Path) -> tuple[Path, ...]:
    """Return the files of the recording in a folder, or of the one that a file belongs to.

    Raises
    ------
    LogFormatError
        If the folder holds several recordings.
    """
    folder = path if path.is_dir() else path.parent
    parts = [each for each in sorted(folder.iterdir()) if _part(each) in _PARTS]
    names = sorted({each.name.rpartition("_")[0] for each in parts if _part(each) == "motors"})
    if not path.is_dir():
        if path not in parts:
            return (path,)
        names = [path.name.rpartition("_")[0]]
    if len(names) > 1:
        raise LogFormatError(
            f"{path}: holds {len(names)} recordings, {', '.join(names)}; name one of their files"
        )
    landmarks = [each for each in sorted(folder.iterdir()) if _part(each) == "landmarks"]
    return (*(each for each in parts if each.name.rpartition("_")[0] in names), *landmarks)


def _part(path: Path) -> str:
    """Return the kind of a file by its name: `motors` of `robot4_motors.txt.gz`."""
    name = path.name.removesuffix(".gz")
    return name.rpartition("_")[2].removesuffix(".txt") if name.endswith(".txt") else ""


def read_lego(path: Path, unit: str = "ms") -> Recording:
    """Read the recording in a folder, or that to which one of its files belongs.

    Its times are in one of `times.TIME_UNITS`.

    Raises
    ------
    LogFormatError
        If a line is damaged, there are no wheel ticks, or the folder holds several recordings.
    OSError
        If a file cannot be read.
    """
    lines: _Lines = defaultdict(list)
    notes: list[str] = []
    for file in lego_files(path):
        text = read_text(file)
        notes.extend(text.notes())
        _take_in(text, lines, notes)
    if not lines["M"]:
        raise LogFormatError(f"{path}: no wheel ticks in it; needed are lines M t l . . . r")
    note_pairs(np.array([line.values[0] for line in lines["S"]]), "scans", notes)
    found = _in_order(
        {"lines M": lines["M"], "scans": lines["S"], "lines P": lines["P"]}, unit, notes
    )
    motors = found["lines M"]
    ticks = np.array([(at, row[1], row[5]) for at, row in motors.with_times()], dtype=np.int64)
    rows = wheel_odometry(ticks).poses.tolist()
    odometry = Odometry(path, replace(motors, what="wheel odometry", values=rows), notes)
    return Recording(
        name=path.name,
        scans=tuple(_scans(found["scans"], odometry)),
        odometry=odometry.trajectory,
        reference=_reference(found["lines P"], notes),
        reference_has_heading=False,
        landmarks={
            i: (1e-3 * x, 1e-3 * y) for i, (x, y) in enumerate(line.values for line in lines["L"])
        },
        wheel_ticks=ticks,
        notes=tuple(notes),
    )


def wheel_odometry(
    ticks: NDArray[np.int64], tick_m: float = TICK_M, track_width_m: float = TRACK_WIDTH_M
) -> Trajectory:
    """Return the odometry from (0, 0, 0) on, computed from `Recording.wheel_ticks`."""
    pose = SE2()
    poses = [(0.0, 0.0, 0.0)]
    steps = np.diff(ticks[:, 1:], axis=0) * tick_m
    for left_m, right_m in steps.tolist():
        pose = arc(pose, 0.5 * (left_m + right_m), (right_m - left_m) / track_width_m)
        poses.append((pose.x_m, pose.y_m, pose.theta_rad))
    return Trajectory(ticks[:, 0], np.array(poses))


def _take_in(text: LogText, lines: _Lines, notes: list[str]) -> None:
    """Add the lines of one file."""
    for number, line in enumerate(text.lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            lines[words[0]].append(_Line(text, number, _values(text, number, words)))
        except LogFormatError:
            if not text.is_open_end(number):
                raise
            notes.append(f"{text.path}:{number}: the last line is cut short, left out")


def _values(text: LogText, number: int, words: Sequence[str]) -> list[float]:
    """Return the numbers of a line, whole apart from the time; x and y [mm] for a landmark."""
    kind = words[0]
    if kind not in _NEEDED:
        raise text.error(
            number, f"found {kind[:24]!r}, a line begins with one of {', '.join(LINES)}"
        )
    if len(words) < _NEEDED[kind]:
        raise text.error(
            number,
            f"{kind}: found {len(words) - 1} values, at least {_NEEDED[kind] - 1} are needed",
        )
    if kind == "L":
        return [_finite(text, number, kind, word) for word in words[2:4]]
    values = [_finite(text, number, kind, words[1])]
    values += [integer(text, number, kind, word) for word in words[2:]]
    if kind == "S" and values[1] != len(values) - 2:
        raise text.error(
            number, f"S: found {len(values) - 2} ranges, the line tells of {values[1]}"
        )
    return values


def _finite(text: LogText, number: int, kind: str, word: str) -> float:
    """Return a time, or a length [mm]."""
    value = float(numbers(text, number, [word])[0])
    if not math.isfinite(value):
        raise text.error(number, f"{kind}: found {word[:24]!r}, a finite number is needed")
    return value


def _in_order(kinds: dict[str, list[_Line]], unit: str, notes: list[str]) -> dict[str, Series]:
    """Return the values of lines of each kind, which may be in separate files."""
    timeline: Timeline[str] = Timeline(notes)
    for kind, lines in kinds.items():
        stamps_ns = going_on(
            np.array([line.values[0] for line in lines]),
            unit,
            kind,
            notes,
            lambda at, problem, lines=lines: lines[at].text.error(lines[at].number, problem),  # type: ignore[misc]
        )
        timeline.add_file(kind, stamps_ns.tolist(), [line.values for line in lines])
    return timeline.settled()


def _reference(positions: Series, notes: list[str]) -> Trajectory | None:
    """Return the positions seen by the camera, with heading 0."""
    rows = [(1e-3 * x, 1e-3 * y, 0.0) for _, x, y, *_ in positions.values]
    known = trajectory(replace(positions, values=rows), notes) if rows else None
    return None if known is None else known[0]


def _scans(scans: Series, odometry: Odometry) -> list[RecordedScan]:
    """Return the scans with the odometry at their times."""
    found = []
    for stamp_ns, values, pose in odometry.place(scans):
        ranges = np.array(values[2:])
        ranges = np.where(ranges > _ERROR_MM, 1e-3 * ranges, math.nan)
        angles = BEAM_STEP_RAD * (np.arange(len(ranges), dtype=np.float64) - FORWARD_BEAM)
        scan = RangeScan(stamp_ns, SCANNER_TURN_RAD + angles, ranges, REACH_M, SCANNER_X_M)
        found.append(RecordedScan(scan, pose))
    return found


def _matches(path: Path) -> bool:
    return is_lego(path) if path.is_dir() else first_word(path) in LINES


def _read(path: Path, options: ReadOptions) -> Recording:
    return read_lego(path, options.time_unit or "ms")


LEGO: Final = LogFormat(
    "a log of the LEGO robot", _matches, _read, has_time_unit=True, in_folder="*_motors.txt"
)
