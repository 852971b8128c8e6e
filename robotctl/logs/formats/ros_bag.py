"""ROS 1 bags, ROS 2 bags (SQLite and MCAP) and MCAP files of ROS 2 as drives; needs rosbags.

LaserScan, Odometry and tf messages of any topic are read. `base` is the child frame of the
odometry, if that is on the robot. tf gives the laser's mounting: it may be off centre, rotated or
upside down, but must be level. Without Odometry messages the motion of a frame in one called odom
counts. The reference is an Odometry topic whose name marks it as the truth, else the pose of `base`
in the frame above odom, such as map, published by the robot's own localiser.

A reading at or above `range_max` or one of the lengths that `no_echo` finds is inf, one below
`range_min` is none (nan). Times are those of the message headers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.no_echo import reaches, valid_ranges
from robotctl.logs.formats.placing import trajectory
from robotctl.logs.formats.ros_content import (
    BagContent,
    RawScan,
    ScanSource,
    content_of,
    in_plane,
)
from robotctl.logs.formats.ros_messages import is_ros_bag
from robotctl.logs.formats.ros_robot import BagRobot, robot_of, truth_of
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.se3 import SE3
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory

_LEVEL: Final = math.cos(math.radians(5.0))


def read_ros_bag(path: Path, max_range_m: float | None = None) -> Recording:
    """Read a bag.

    Parameters
    ----------
    path
        A file, or the folder of a bag.
    max_range_m
        Range from which on there is no echo [m]; None: found as above.

    Raises
    ------
    ConfigError
        If the package rosbags is not installed.
    LogFormatError
        If it is damaged, or has the motion of no robot or of several.
    OSError
        If it cannot be read.
    """
    notes: list[str] = []
    content = content_of(path, notes)
    robot = robot_of(path, content, notes)
    reference = _reference(content, robot, notes)
    scans = _scans(content, robot, reference, max_range_m, notes)
    return Recording(
        name=path.name,
        scans=tuple(scans),
        odometry=robot.odometry.trajectory,
        reference=reference,
        notes=tuple(notes),
    )


def _reference(content: BagContent, robot: BagRobot, notes: list[str]) -> Trajectory | None:
    """Return `base` by a source better than odometry; None without one."""
    truth = truth_of(robot, content)
    if truth is not None and robot.odometry.has_clock_of(content.odometry[truth]):
        found = trajectory(content.odometry[truth], notes)
        notes.append(f"reference: {truth.topic}")
        return None if found is None else found[0]
    frames, base, odom = content.frames, robot.base, robot.odom
    odometry = robot.odometry.trajectory
    stamps_ns, rows = odometry.stamps_ns.tolist(), odometry.poses.tolist()
    above = frames.chain(odom)
    if any(map(frames.moves, above[:-1])):
        world, moved, rest = "map" if "map" in above else above[-1], odom, rows
    elif len(above) == 1 and odom not in frames.chain(base) and frames.moves(base):
        world, moved, rest = frames.chain(base)[-1], base, [(0.0, 0.0, 0.0)] * len(rows)
    else:
        notes.append("no reference: no tf of a frame above the odometry's that moves")
        return None
    known = [
        (stamp_ns, in_plane(pose) @ SE2(*row))
        for stamp_ns, row in zip(stamps_ns, rest, strict=True)
        if (pose := frames.lookup(world, moved, stamp_ns)) is not None
    ]
    if not known:
        notes.append(f"no reference: tf says where {moved} is in {world} at other times only")
        return None
    notes.append(f"reference: {base} in {world} by tf, of the robot's own localiser or mapper")
    return Trajectory.of((at for at, _ in known), (pose for _, pose in known))


def _scans(
    content: BagContent,
    robot: BagRobot,
    reference: Trajectory | None,
    max_range_m: float | None,
    notes: list[str],
) -> list[RecordedScan]:
    """Return the scans of all lasers in the order of their times."""
    found: list[RecordedScan] = []
    seen: dict[str, str] = {}
    for laser in sorted(content.scans, key=lambda each: robot.rank(each, len(content.scans[each]))):
        if laser.frame in seen:
            notes.append(f"{laser.topic}: of the laser of {seen[laser.frame]}, left out")
            continue
        base = robot.mount_of(laser, content, notes)
        if base is None:
            continue
        name = laser.frame if seen else ""
        seen[laser.frame] = laser.topic
        found += [
            replace(each, scan=replace(each.scan, name=name))
            for each in _of_laser(content, robot, laser, base, reference, max_range_m, notes)
        ]
    return sorted(found, key=lambda entry: entry.scan.stamp_ns)


def _of_laser(
    content: BagContent,
    robot: BagRobot,
    laser: ScanSource,
    base: str,
    reference: Trajectory | None,
    max_range_m: float | None,
    notes: list[str],
) -> Iterator[RecordedScan]:
    """Yield the scans of one laser, mounted on the frame `base`."""
    placed = robot.odometry.place(content.scans[laser])
    raw: list[RawScan] = [scan for _, scan, _ in placed]
    readings = [scan.ranges_m.astype(np.float64) for scan in raw]
    places = np.array([(pose.x_m, pose.y_m) for *_, pose in placed]).reshape(-1, 2)
    stated_m = [scan.max_range_m for scan in raw]
    reaches_m = reaches(laser.topic, readings, places, stated_m, max_range_m, notes) if raw else []
    fans: dict[tuple[Any, ...], NDArray[np.float64]] = {}
    tilted = unknown = 0
    for (stamp_ns, scan, pose), ranges, reach_m in zip(placed, readings, reaches_m, strict=True):
        mount = content.frames.lookup(base, laser.frame, stamp_ns)
        if mount is None:
            unknown += 1
            continue
        if abs(float(mount.rotation()[2, 2])) < _LEVEL:
            tilted += 1
            continue
        key = len(ranges), scan.first_rad, scan.step_rad, mount.quaternion
        if key not in fans:
            fans[key] = _directions(scan, mount)
        x_m, y_m, _ = mount.translation_m
        valid = valid_ranges(ranges, reach_m)
        # A message has the time of its first ray, a scan that of its last.
        end_ns, sweep_s = stamp_ns + round(1e9 * scan.sweep_s), scan.sweep_s
        at_end = robot.odometry.trajectory.at(end_ns) if sweep_s else None
        if at_end is None:
            at_end, end_ns, sweep_s = pose, stamp_ns, 0.0
        yield RecordedScan(
            RangeScan(end_ns, fans[key], valid, reach_m, x_m, y_m, sweep_s=sweep_s),
            at_end,
            reference.at(end_ns) if reference else None,
        )
    if unknown:
        notes.append(
            f"{unknown} of {len(placed)} {laser} left out: tf does not say where {laser.frame} is "
            f"in {base} at their times"
        )
    if tilted:
        notes.append(f"{laser.topic}: {tilted} of {len(placed)} scans are not level, left out")


def _directions(scan: RawScan, mount: SE3) -> NDArray[np.float64]:
    """Return the directions of the beams of a scan in `base`, (n,) [rad]."""
    count = len(scan.ranges_m)
    angles = scan.first_rad + scan.step_rad * np.arange(count, dtype=np.float64)
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    x, y, _ = (beams @ mount.rotation().T).T
    return np.asarray(np.unwrap(np.arctan2(y, x)))


def _read(path: Path, options: ReadOptions) -> Recording:
    return read_ros_bag(path, options.max_range_m)


ROS_BAG: Final = LogFormat(
    "a ROS bag", is_ros_bag, _read, has_time_unit=False, in_folder="metadata.yaml, *.bag"
)
