"""Folders of the UTIAS multi-robot localisation and mapping data set (MRCLAM), one robot of five.

A folder holds `Barcodes.dat`, `Landmark_Groundtruth.dat`, and for each robot
`RobotN_Odometry.dat`, `RobotN_Measurement.dat`, `RobotN_Groundtruth.dat`, plain or with `.gz`.
Sightings name bar codes, the other files subjects: 1 to 5 are robots, from 6 on landmarks. Times
are [s] of one clock. A velocity holds until the next one.
Source: Leung, Halpern, Barfoot, Liu: The UTIAS multi-robot cooperative localization and mapping
dataset, IJRR 30(8), 2011; http://asrl.utias.utoronto.ca/datasets/mrclam
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError, LogText, read_text, row_number, table
from robotctl.logs.formats.placing import trajectory, within
from robotctl.logs.formats.timeline import Series, Timeline
from robotctl.logs.formats.times import going_on
from robotctl.model.recording import Recording, Sighting
from robotctl.model.trajectory import Trajectory

ROBOTS: Final = 5
_OF_ROBOT: Final = re.compile(r"Robot(\d+)_(Odometry|Measurement|Groundtruth)\.dat(\.gz)?")
_BARCODE: Final = ("subject", "barcode")
_LANDMARK: Final = ("subject", "x", "y", "x std-dev", "y std-dev")
_ODOMETRY: Final = ("time", "forward velocity", "angular velocity")
_MEASUREMENT: Final = ("time", "barcode", "range", "bearing")
_GROUNDTRUTH: Final = ("time", "x", "y", "orientation")


def is_mrclam(folder: Path) -> bool:
    """Return whether a folder is such a set, by the names of its files."""
    return any(_OF_ROBOT.fullmatch(path.name) for path in folder.iterdir())


def robot_of(file: Path) -> int | None:
    """Return the robot of a file by its name; None without one."""
    match = _OF_ROBOT.fullmatch(file.name)
    return int(match[1]) if match else None


def read_mrclam(folder: Path, robot: int, unit: str = "s") -> Recording:
    """Read one robot's records, with times in one of `times.TIME_UNITS`.

    Sightings of other robots, of unknown bar codes, and at times without odometry are left out and
    counted in the notes. Without a ground truth of the robot there is no reference.

    Raises
    ------
    LogFormatError
        If a file is missing or damaged, or the robot is not in the set.
    OSError
        If a file cannot be read.
    """
    _check_robot(folder, robot)
    notes: list[str] = []
    landmarks = {
        int(subject): (x, y)
        for subject, x, y, *_ in _rows(folder, "Landmark_Groundtruth", _LANDMARK, notes).tolist()
    }
    barcodes = _rows(folder, "Barcodes", _BARCODE, notes).tolist()
    subject_of = {int(code): int(subject) for subject, code in barcodes}
    odometry = _timed(folder, f"Robot{robot}_Odometry", _ODOMETRY, unit, notes)
    return Recording(
        name=f"{folder.name}, robot {robot}",
        twist_stamps_ns=odometry.stamps_ns,
        twists=np.array(odometry.values).reshape(-1, 2),
        reference=_reference(folder, robot, unit, notes),
        sightings=_sightings(folder, robot, unit, odometry.stamps_ns, subject_of, landmarks, notes),
        landmarks=landmarks,
        notes=tuple(notes),
    )


def _check_robot(folder: Path, robot: int) -> None:
    """Refuse a robot without odometry in the folder."""
    there = sorted(
        {
            int(match[1])
            for path in folder.iterdir()
            if (match := _OF_ROBOT.fullmatch(path.name)) and match[2] == "Odometry"
        }
    )
    if robot not in there:
        names = ", ".join(map(str, there)) or "none"
        raise LogFormatError(f"{folder}: no odometry of robot {robot}; there is that of {names}")


def _rows(
    folder: Path, name: str, columns: tuple[str, ...], notes: list[str]
) -> NDArray[np.float64]:
    """Return the rows of one file, (n, columns)."""
    return table(_text(folder, name, notes), columns)


def _text(folder: Path, name: str, notes: list[str]) -> LogText:
    """Return the text of one file."""
    plain, packed = folder / f"{name}.dat", folder / f"{name}.dat.gz"
    if not plain.exists() and not packed.exists():
        raise LogFormatError(f"{folder}: {plain.name} is missing, with .gz and without")
    text = read_text(plain if plain.exists() else packed)
    notes.extend(text.notes())
    return text


def _timed(
    folder: Path, name: str, columns: tuple[str, ...], unit: str, notes: list[str]
) -> Series:
    """Return the rows of a file without their first column, the time."""
    text = _text(folder, name, notes)
    rows = table(text, columns)
    what = f"rows of {name}"
    stamps_ns = going_on(
        rows[:, 0],
        unit,
        what,
        notes,
        lambda at, problem: text.error(row_number(text, at), problem),
    )
    timeline: Timeline[str] = Timeline(notes)
    timeline.add_file(what, stamps_ns.tolist(), rows[:, 1:].tolist())
    return timeline.settled()[what]


def _reference(folder: Path, robot: int, unit: str, notes: list[str]) -> Trajectory | None:
    """Return the robot's poses by motion capture."""
    name = f"Robot{robot}_Groundtruth"
    if not any((folder / f"{name}.dat{packed}").exists() for packed in ("", ".gz")):
        return None
    known = trajectory(_timed(folder, name, _GROUNDTRUTH, unit, notes), notes)
    return None if known is None else known[0]


def _sightings(
    folder: Path,
    robot: int,
    unit: str,
    known_ns: NDArray[np.int64],
    subject_of: dict[int, int],
    landmarks: dict[int, tuple[float, float]],
    notes: list[str],
) -> tuple[Sighting, ...]:
    """Return the robot's sightings of landmarks while there is odometry."""
    name = f"Robot{robot}_Measurement"
    rows = _timed(folder, name, _MEASUREMENT, unit, notes)
    found, robots, strangers, empty = [], 0, 0, 0
    is_inside = within(rows, known_ns, notes) if len(known_ns) else np.ones(len(rows), bool)
    for is_known, (stamp_ns, (code, range_m, bearing_rad)) in zip(
        is_inside.tolist(), rows.with_times(), strict=True
    ):
        if not is_known:
            continue
        subject = subject_of.get(int(code))
        if range_m <= 0.0:
            empty += 1
        elif subject in landmarks:
            found.append(Sighting(stamp_ns, subject, range_m, bearing_rad))
        elif subject is not None and 1 <= subject <= ROBOTS:
            robots += 1
        else:
            strangers += 1
    if empty:
        notes.append(f"{name}: {empty} of {len(rows)} sightings have no range, left out")
    if robots:
        notes.append(f"{name}: {robots} of {len(rows)} sightings are of other robots, left out")
    if strangers:
        notes.append(
            f"{name}: {strangers} of {len(rows)} sightings are of bar codes that belong to no "
            "landmark and no robot, left out"
        )
    return tuple(found)


def _matches(path: Path) -> bool:
    return is_mrclam(path) if path.is_dir() else robot_of(path) is not None


def _read(path: Path, options: ReadOptions) -> Recording:
    if path.is_dir():
        return read_mrclam(path, options.mrclam_robot or 1, options.time_unit or "s")
    robot = options.mrclam_robot or robot_of(path) or 1
    return read_mrclam(path.parent, robot, options.time_unit or "s")


MRCLAM: Final = LogFormat(
    "a MRCLAM folder", _matches, _read, has_time_unit=True, in_folder="RobotN_Odometry.dat"
)
