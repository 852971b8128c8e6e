"""Logs of CARMEN, the Carnegie Mellon robot navigation toolkit, as in public data sets.

Whose pose: in FLASER lines `x y theta` is the pose of the *laser* in `world`, the reference, and
`odom_x odom_y odom_theta` that of the *robot* by odometry (CARMEN's messages). The data agree: a
map of Freiburg 079, whose laser is 0.04 m behind the centre, is sharpest when the beams start in `x
y theta` itself. If both are the same in every line, both are the laser's: the reference in a log
that was corrected in place, odometry in a log as recorded. If the robot revisits a place, scans
decide: at the right poses they agree. Otherwise the correcting program leaves traces, NEFF lines,
ODOM lines at the time 0, or ODOM lines at other poses than the scans'; with the same poses there is
no reference, nor if the laser never moves while the robot does. ROBOTLASER lines hold the pose of
the laser, then of the robot.

Mounting: PARAM `robot_frontlaser_offset`, `_side_offset` and `_angular_offset`, likewise
`robot_rearlaser_...`; RLASER and ROBOTLASER2 look backwards. Without them, ROBOTLASER lines give
it if their two poses have a constant relation; else the laser is in the centre.

Beams: 180 readings lie at -90, -89, ... 89 deg, 181 at -90 ... 90 deg, 360 and 361 likewise by half
a degree; 100, 200 and 400 (101, 201, 401) begin at -50 deg: the fields of view of a SICK LMS. Other
numbers are spread over -90 ... 90 deg. The first reading is the rightmost.

Reach: readings at or above the maximum are inf, those of 0 or less no readings (nan). The maximum
is the shortest length that stands for no echo (`no_echo`), or less where PARAM
`robot_front_laser_max` or the field of ROBOTLASER says so and hardly an echo lies beyond it:
readings are trusted more than the header. The fallback is 81.83 m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.grid.revisits import revisit_agreement
from robotctl.logs.formats.carmen_lines import (
    KNOWN,
    CarmenLines,
    LaserLine,
    OdometryLine,
    sorted_lines,
)
from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError, first_word, read_text
from robotctl.logs.formats.no_echo import reaches, valid_ranges
from robotctl.logs.formats.placing import Odometry, trajectory
from robotctl.logs.formats.timeline import Series, Timeline
from robotctl.logs.formats.times import checked_stamps, note_pairs
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory

_SAME, _ROUNDED = 1e-5, 2e-3
_ELSEWHERE_M: Final = 0.2
_AGREEMENT: Final = 0.4
_STEADY_M, _STEADY_RAD = 0.005, 0.005
_MAX_MOUNT_M: Final = 1.5
_SCANS, _ODOMETRY = "scans", "ODOM lines"
_BURST_NS: Final = 1_000_000_000
"""Maximum delay of bursts of lines by two programs with their own clocks [ns]; 0.8 s in the Intel
log."""


def read_carmen(path: Path, unit: str = "s", max_range_m: float | None = None) -> Recording:
    """Read a log.

    Times are those of the messages, in the order of `Timeline`.

    Parameters
    ----------
    path
        The file.
    unit
        Unit of its times, one of `TIME_UNITS`.
    max_range_m
        Reading from which on there is no echo [m]; None: found as above.

    Raises
    ------
    LogFormatError
        If a line is damaged, or there is neither a scan nor odometry in the log.
    OSError
        If the file cannot be read.
    """
    lines = sorted_lines(read_text(path))
    if not lines.lasers and not lines.odometry:
        raise LogFormatError(
            f"{path}: no scan and no odometry in it; needed are lines with FLASER, RLASER, "
            "ROBOTLASER1 or ODOM"
        )
    scans, odometry = _drive(lines, unit, max_range_m)
    known = [(scan.scan.stamp_ns, scan.reference) for scan in scans if scan.reference]
    reference = None
    if known:
        stamps_ns, poses = zip(*known, strict=True)
        reference = Trajectory.of(stamps_ns, poses)
    return Recording(
        name=path.name,
        scans=tuple(scans),
        odometry=odometry,
        reference=reference,
        notes=tuple(lines.notes),
    )


def _drive(
    lines: CarmenLines, unit: str, max_range_m: float | None
) -> tuple[list[RecordedScan], Trajectory]:
    """Return the scans of all lasers in the order of the log, and the odometry.

    The odometry is that of the ODOM lines, or of the scans without any. Poses at the time 0,
    inserted by programs that correct logs, are left out.
    """
    entries: list[tuple[LaserLine | OdometryLine, str, object]] = [
        (line, _SCANS, placed)
        for word, laser_lines in lines.lasers.items()
        for line, placed in zip(
            laser_lines, _placed(lines, word, laser_lines, max_range_m), strict=True
        )
    ]
    timed = [line for line in lines.odometry if line.time != 0.0] or lines.odometry
    if len(timed) != len(lines.odometry):
        lines.notes.append(f"{len(lines.odometry) - len(timed)} ODOM lines without a time left out")
    entries += [(line, _ODOMETRY, line.pose) for line in timed]
    entries.sort(key=lambda entry: entry[0].number)
    stamps_ns = checked_stamps(
        np.array([line.time for line, *_ in entries]),
        unit,
        lambda at, problem: lines.text.error(entries[at][0].number, problem),
    )
    timeline: Timeline[str] = Timeline(lines.notes, _BURST_NS)
    for stamp_ns, (line, source, value) in zip(stamps_ns.tolist(), entries, strict=True):
        timeline.add(source, stamp_ns, value, lines.text.lines[line.number - 1])
    return _in_time(lines, timeline.settled())


def _in_time(
    lines: CarmenLines, found: Mapping[str, Series]
) -> tuple[list[RecordedScan], Trajectory]:
    """Return scans and odometry of entries in the order of their times.

    Scans have their own poses. Poses by odometry alone must not jump.
    """
    path, notes = lines.text.path, lines.notes
    scans, series = [], found.get(_ODOMETRY)
    if _SCANS in found:
        scans = [
            RecordedScan(replace(scan, stamp_ns=stamp_ns), odometry, reference)
            for stamp_ns, (scan, odometry, reference) in found[_SCANS].with_times()
        ]
        poses = [each.odometry for each in scans]
        rows = [(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]
        of_scans = replace(found[_SCANS], what="poses of the scans", values=rows)
        if not any(each.reference for each in scans):
            scans = [scans[row] for row in Odometry(path, of_scans, notes).rows.tolist()]
        series = series or of_scans
    known = None if series is None else trajectory(series, notes)
    if known is None:
        raise LogFormatError("; ".join([f"{path}: no pose of use in it", *notes]))
    return scans, known[0]


_Placed = tuple[RangeScan, SE2, SE2 | None]


def _placed(
    lines: CarmenLines, word: str, scans: Sequence[LaserLine], max_range_m: float | None
) -> list[_Placed]:
    """Return each scan of one laser at the time 0, with its odometry and reference."""
    note_pairs(np.array([scan.time for scan in scans]), f"{word} scans", lines.notes)
    laser = [SE2(*scan.laser.tolist()) for scan in scans]
    robot = [SE2(*scan.robot.tolist()) for scan in scans]
    rear = word in {"RLASER", "ROBOTLASER2"}
    if rear and abs(wrap_angle(laser[0].theta_rad - robot[0].theta_rad)) < 0.5 * math.pi:
        laser = [pose @ SE2(0.0, 0.0, math.pi) for pose in laser]  # the heading is the robot's
    mount = _mount(lines, word, rear, [a.inverse() @ b for a, b in zip(robot, laser, strict=True)])
    reference = [pose @ mount.inverse() for pose in laser]
    in_place = all(np.all(np.abs(scan.laser - scan.robot) < _SAME) for scan in scans)
    robot = reference if in_place else robot
    beams = [scan.fan or _fan(lines, rear, len(scan.ranges_m)) for scan in scans]
    stated_m = [stated if stated > 0.0 else math.inf for _, _, stated in beams]
    readings = [scan.ranges_m for scan in scans]
    places = np.array([scan.robot[:2] for scan in scans])
    reaches_m = reaches(word, readings, places, stated_m, max_range_m, lines.notes)
    fans: dict[tuple[int, float, float], NDArray[np.float64]] = {}
    shapes = []
    for scan, (first, step, _), reach_m in zip(scans, beams, reaches_m, strict=True):
        key = len(scan.ranges_m), first, step
        angles = fans.setdefault(
            key, mount.theta_rad + first + step * np.arange(key[0], dtype=np.float64)
        )
        ranges = valid_ranges(scan.ranges_m, reach_m)
        name = "rear" if rear else ""
        shapes.append(RangeScan(0, angles, ranges, reach_m, mount.x_m, mount.y_m, name=name))
    lacks = _lacks_reference(lines, word, scans, shapes, robot, reference)
    known = [None] * len(scans) if lacks else reference
    return list(zip(shapes, robot, known, strict=True))


def _lacks_reference(
    lines: CarmenLines,
    word: str,
    scans: Sequence[LaserLine],
    shapes: Sequence[RangeScan],
    robot: Sequence[SE2],
    reference: Sequence[SE2],
) -> bool:
    """Return whether the apparent reference is not one, and note it."""
    if len(scans) > 1 and not np.any(np.ptp([scan.laser for scan in scans], axis=0)) and (
        np.any(np.ptp([scan.robot for scan in scans], axis=0))
    ):  # fmt: skip
        lines.notes.append(f"{word}: the laser's pose is the same in all lines: no reference")
        return True
    if not all(map(_is_same, reference, robot)):
        return False
    agreement = revisit_agreement(shapes, reference)
    is_none = _is_as_recorded(lines, scans) if agreement is None else agreement < _AGREEMENT
    seen = "" if agreement is None else f" ({agreement:.0%} of the echoes agree at later visits)"
    lines.notes.append(
        f"{word}: both poses of all lines are the same: "
        + (
            f"a log as it was recorded, by odometry, has no reference{seen}"
            if is_none
            else f"a log corrected in place has no odometry of its own{seen}"
        )
    )
    return is_none


def _is_same(one: SE2, other: SE2) -> bool:
    """Return whether two poses are the same, apart from the rounding of their text."""
    return (
        math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) < _ROUNDED
        and abs(wrap_angle(one.theta_rad - other.theta_rad)) < _ROUNDED
    )


def _is_as_recorded(lines: CarmenLines, scans: Sequence[LaserLine]) -> bool:
    """Return whether the single pose of the scans is odometry, by the ODOM lines."""
    untimed = sum(line.time == 0.0 for line in lines.odometry)
    if "NEFF" in lines.kinds or 0 < untimed < len(lines.odometry):
        return False
    rows = np.array([(line.time, *line.pose[:2]) for line in lines.odometry]).reshape(-1, 3)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    times = np.array([scan.time for scan in scans])
    inside = np.array([len(rows) > 0 and rows[0, 0] <= time <= rows[-1, 0] for time in times])
    if not np.any(inside):
        return False
    at = np.stack([np.interp(times[inside], rows[:, 0], rows[:, axis]) for axis in (1, 2)], axis=1)
    robot = np.array([scan.robot[:2] for scan in scans])[inside]
    return bool(np.median(np.hypot(*(at - robot).T)) < _ELSEWHERE_M)


def _mount(lines: CarmenLines, word: str, rear: bool, between: Sequence[SE2]) -> SE2:
    """Return the laser's pose in `base`; `between` is that by the two poses of each line."""
    side = "robot_rearlaser" if rear else "robot_frontlaser"
    names = (f"{side}_offset", f"{side}_side_offset", f"{side}_angular_offset")
    x, y, theta = (lines.parameter(name) for name in names)
    behind = math.pi if rear else 0.0
    if x is not None or word in {"FLASER", "RLASER"}:
        return SE2(x or 0.0, y or 0.0, wrap_angle(behind + (theta or 0.0)))
    first = between[0]
    steady = all(
        math.hypot(pose.x_m - first.x_m, pose.y_m - first.y_m) < _STEADY_M
        and abs(wrap_angle(pose.theta_rad - first.theta_rad)) < _STEADY_RAD
        for pose in between
    )
    if steady and math.hypot(first.x_m, first.y_m) < _MAX_MOUNT_M:
        return first
    return SE2(0.0, 0.0, behind)


def _fan(lines: CarmenLines, rear: bool, count: int) -> tuple[float, float, float]:
    """Return direction of the first beam, step [rad], and maximum range of PARAM [m]."""
    reach_m = lines.parameter(f"robot_{'rear' if rear else 'front'}_laser_max") or math.inf
    for beams, view_deg in ((180, 180.0), (360, 180.0), (100, 100.0), (200, 100.0), (400, 100.0)):
        if count in {beams, beams + 1}:
            return math.radians(-0.5 * view_deg), math.radians(view_deg / beams), reach_m
    return -0.5 * math.pi, math.pi / max(count - 1, 1), reach_m


def _matches(path: Path) -> bool:
    return path.is_file() and first_word(path) in KNOWN


def _read(path: Path, options: ReadOptions) -> Recording:
    return read_carmen(path, options.time_unit or "s", options.max_range_m)


CARMEN: Final = LogFormat("a CARMEN log", _matches, _read, has_time_unit=True)
