"""SLAM by lidar on public logs of ROBOTCTL_DATA: relations, corrected poses, time, memory."""

from __future__ import annotations

import gzip
import math
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.estimation.slam.keyframes.candidates import PossiblePlaces
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.shapes import AROUND, Shapes
from robotctl.estimation.slam_tuning import ShapeConfig
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.scans import ScanResult, scan_slam_of

GOALS = "0.031 m, 1.0 deg of relations; ape 0.15 m; 15 ms a scan, p99 60 ms; Intel 20 s"
LOGS = (
    ("intel-odometry", True),
    ("intel-odometry", False),
    ("seattle-corrected", False),
    ("freiburg-079-corrected", False),
    ("fhw-odometry", True),
    ("fhw-odometry", False),
    ("acapulco-odometry", True),
    ("acapulco-odometry", False),
)
EXACT_NS = 1_000_000
"""A relation is between two scans if they have its times to a millisecond."""


def relations(path: Path, estimate: Trajectory) -> tuple[int, float, float, float, float]:
    """Return the number of relations, the mean and the greatest error [m], the same [deg].

    Kümmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27 (2009),
    equation 4: each published relation against that of the estimate, translation and rotation.
    """
    rows = {stamp_ns: row for row, stamp_ns in enumerate(estimate.stamps_ns.tolist())}
    stamps_ns = np.array(list(rows))
    shifts, turns = [], []
    with gzip.open(path, "rt", encoding="ascii") as file:
        for line in file:
            first, second, x, y, _, _, _, yaw = map(float, line.split())
            ends = []
            for time_s in (first, second):
                nearest = int(np.argmin(np.abs(stamps_ns - 1e9 * time_s)))
                if abs(float(stamps_ns[nearest]) - 1e9 * time_s) < EXACT_NS:
                    ends.append(SE2(*estimate.poses[rows[int(stamps_ns[nearest])]].tolist()))
            if len(ends) == 2:
                off = SE2(x, y, yaw).inverse() @ ends[0].inverse() @ ends[1]
                shifts.append(math.hypot(off.x_m, off.y_m))
                turns.append(math.degrees(abs(off.theta_rad)))
    return len(shifts), *(f(each) for each in (shifts, turns) for f in (np.mean, np.max))


def without_odometry(recording: Recording) -> Recording:
    """Return a recording whose odometry is as good as none: that of a log corrected in place."""
    scans = tuple(replace(each, reference=each.odometry) for each in recording.scans)
    return replace(recording, scans=scans)


def row_of(name: str, result: ScanResult) -> tuple[str, ...]:
    """Return the figures of a log."""
    report = result.report()
    times = report["time_ms"]
    return (
        name,
        "yes" if report["odometry"] else "no",
        str(report["scans"]),
        str(report["keyframes"]),
        f"{report['loops']['closed']} / {sum(report['loops']['refused'].values())}",
        str(report["links_of_loops"]),
        str(report["unmatched"]),
        f"{report['trajectory']['rmse_m']:.3f}",
        f"{report['online']['rmse_m']:.3f}",
        f"{times['mean']:.1f} / {times['p99']:.1f} / {times['max']:.1f}",
        f"{1e-3 * (times['scans'] + times['grid']):.1f}",
    )


def alike_row(name: str, mapper: SlamMapper) -> tuple[str, ...]:
    """Return how often a place seen before is the one of most like shape, whatever the heading.

    Of keyframes that have another within 0.5 m, 8 m of way before them; right is within 1.5 m and
    20 deg, by the finished map.
    """
    poses, keyframes = mapper.back_end.poses, mapper.keyframes
    shapes = Shapes(ShapeConfig(least_score=0.0))
    way_m = np.array([each.travelled_m for each in keyframes])
    hits, took_ns = np.zeros((0, 2), np.bool_), 0
    for number in range(len(keyframes)):
        around = range(max(number - AROUND, 0), number + 1)
        shapes.add(
            [(mapper.back_end.between(number, e), keyframes[e].surface.points) for e in around]
        )
        old = np.flatnonzero(way_m[: number + 1] < way_m[number] - 8.0)
        away = np.hypot(*(poses[old, :2] - poses[number, :2]).T)
        if away.min(initial=np.inf) > 0.5:
            continue
        anyhow = PossiblePlaces(number, old, np.zeros(len(old)), np.full(len(old), 4.0))
        began_ns = time.process_time_ns()
        found = shapes.suggest(anyhow).candidates
        took_ns += time.process_time_ns() - began_ns
        right = [
            math.hypot(at.x_m, at.y_m) < 1.5
            and abs(math.remainder(at.theta_rad - each.pose.theta_rad, math.tau))
            < math.radians(20.0)
            for each in found
            for at in (mapper.back_end.between(each.place, number),)
        ]
        hits = np.vstack([hits, [right[0], any(right)]])
    count = len(hits)
    return (
        name, str(count), *(f"{100.0 * each:.0f} %" for each in hits.mean(axis=0)),
        f"{1e-6 * took_ns / max(count, 1):.2f}",
    )  # fmt: skip


def memory_mib(log: Path) -> float:
    """Return the most memory that `robotctl slam` takes for a log, without a picture [MiB]."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["-m", "robotctl", "slam", "--sensor", "lidar", "--log", str(log), "--out", folder]
        process = os.posix_spawn(sys.executable, [sys.executable, *words], os.environ)
        _, status, used = os.wait4(process, 0)
    if status:
        raise RuntimeError(f"robotctl slam --log {log}: status {os.waitstatus_to_exitcode(status)}")
    return used.ru_maxrss / 1024.0


def run(rounds: int, seconds: float) -> None:
    """Map the public logs."""
    machine.note("\n# SLAM by lidar")
    if "ROBOTCTL_DATA" not in os.environ:
        machine.note("ROBOTCTL_DATA is not set: no public logs")
        return
    folder = Path(os.environ["ROBOTCTL_DATA"]) / "carmen"
    rows, notes, alike = [], [], []
    for name, with_odometry in LOGS:
        recording = read_recording(folder / f"{name}.log.gz", with_sonars=False)
        if not with_odometry:
            recording = without_odometry(recording)
        result = scan_slam_of(recording, lambda *_: None)
        rows.append(row_of(name, result))
        if with_odometry or "corrected" in name:
            alike.append(alike_row(name, result.mapper))
        if name == "intel-odometry":
            count, shift, most, turn, turned = relations(
                folder / "intel.relations.gz", result.estimate
            )
            notes.append(
                f"Intel {'with' if with_odometry else 'without'} odometry, {count} relations: mean "
                f"{shift:.4f} m (at most {most:.3f}), {turn:.3f} deg (at most {turned:.2f})"
            )
    heads = (
        "log", "odometry", "scans", "keyframes", "loops closed / refused", "links of loops",
        "unmatched", "ape m", "ape online m", "ms a scan mean / p99 / max", "CPU s",
    )  # fmt: skip
    machine.table("Public logs; ape against the log's own reference, aligned", heads, rows)
    for each in notes:
        machine.note(each)
    heads = ("log", "places seen before", "most alike is right", "of two one is", "ms a query")
    machine.table("Places by shape alone, any heading", heads, alike)
    logs = sorted({folder / f"{name}.log.gz" for name, _ in LOGS})
    memory = [(each.name, f"{memory_mib(each):.0f}") for each in logs]
    machine.table("Memory of the whole process at most", ("log", "MiB"), memory)
    machine.note(f"goals: {GOALS}")
