"""`robotctl slam --sensor lidar`: trajectory and map of a recorded drive, by its lidar scans."""

from __future__ import annotations

import csv
import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from robotctl.errors import RobotctlError
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.lidar.back_end import as_row
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.estimation.slam.lidar.loops import Closure
from robotctl.estimation.slam.lidar.mapper import LEAST_ECHOES, SlamMapper
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.maps.map_file import save_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.result import Estimated

Progress: TypeAlias = Callable[[int, int], None]

_AT_ONCE: Final = 256
_STRAYS: Final = 0.0002
"""As in `robotctl map`: a map is cropped where that cuts off no more of the known cells."""


class LidarSlamError(RobotctlError):
    """A log has no scans."""


@dataclass(frozen=True, slots=True, eq=False)
class LidarResult:
    """A drive after SLAM by lidar.

    Parameters
    ----------
    recording
        The log.
    mapper
        With keyframes, graph and closures.
    estimate, online
        Poses of all scans: with all that was seen, and as they were known at once.
    grid
        The map, of all scans.
    has_odometry
        Whether the log has odometry of its own.
    times_ms
        CPU time of each scan, (n,) [ms].
    grid_ms
        CPU time of the map [ms].
    """

    recording: Recording
    mapper: SlamMapper
    estimate: Trajectory
    online: Trajectory
    grid: OccupancyGrid
    has_odometry: bool
    times_ms: np.ndarray
    grid_ms: float

    def report(self) -> dict[str, Any]:
        """Return the figures; the keys stand in docs/slam.md."""
        back_end, log = self.mapper.back_end, self.mapper.loops.log
        reference = self.recording.reference
        off = sum(weight < OFF for weight in back_end.weights)
        closed = [each for each in log if not each.reason]
        figures = self.grid.figures()
        return {
            "log": self.recording.name,
            "scans": len(self.recording.scans),
            "odometry": self.has_odometry,
            "slips": self.mapper.slips,
            "unmatched": self.mapper.lost,
            "keyframes": len(self.mapper.keyframes),
            "links": len(back_end.links),
            "links_of_loops": sum(link.is_loop for link in back_end.links),
            "switched_off": off,
            "loops": {
                "closed": len(closed),
                "refused": dict(Counter(each.reason for each in log if each.reason)),
            },
            "trajectory": Estimated(self.estimate).compared(reference),
            "online": Estimated(self.online).compared(reference),
            "map": {
                "seen_m2": figures.seen_m2,
                "mean_entropy_bits": figures.mean_entropy_bits,
            },
            "time_ms": {
                "scans": float(self.times_ms.sum()),
                "mean": float(self.times_ms.mean()),
                "p99": float(np.percentile(self.times_ms, 99.0)),
                "max": float(self.times_ms.max()),
                "grid": self.grid_ms,
            },
        }


def has_odometry(recording: Recording) -> bool:
    """Return whether the odometry of a log's scans is any, and not its reference again."""
    return any(
        each.reference is None or each.odometry != each.reference for each in recording.scans
    )


def lidar_slam(log: Path, time_unit: str | None, progress: Progress) -> LidarResult:
    """Make trajectory and map of a log.

    Raises
    ------
    RobotctlError
        If the log cannot be read, or has no scans.
    OSError
        If a file cannot be read.
    """
    recording = read_recording(log, with_sonars=False, time_unit=time_unit)
    first = next(
        (row for row, each in enumerate(recording.scans) if _echoes(each) >= LEAST_ECHOES), None
    )
    if first is None:
        raise LidarSlamError(
            f"{log}: {len(recording.scans)} lidar scans in it, none with {LEAST_ECHOES} echoes, "
            "which --sensor lidar needs"
        )
    if first:
        note = f"{first} scans left out, before the first with {LEAST_ECHOES} echoes"
        recording = replace(
            recording, scans=recording.scans[first:], notes=(*recording.notes, note)
        )
    return lidar_slam_of(recording, progress)


def _echoes(each: RecordedScan) -> int:
    """Return how many echoes a scan has."""
    return len(surface_of(each.scan).points)


def lidar_slam_of(recording: Recording, progress: Progress) -> LidarResult:
    """Map a recording, whose first scan has `LEAST_ECHOES` echoes."""
    _compile(recording)
    mapper, places, online, times_ms = SlamMapper(), [], [], []
    count, by_wheels = len(recording.scans), has_odometry(recording)
    for done, each in enumerate(recording.scans, 1):
        began_ns = time.process_time_ns()
        places.append(mapper.add(each.scan, each.odometry if by_wheels else None))
        times_ms.append(1e-6 * (time.process_time_ns() - began_ns))
        online.append(mapper.pose)
        progress(done, count)
    mapper.finish()
    stamps_ns = [each.scan.stamp_ns for each in recording.scans]
    poses = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    estimate = Trajectory.of(stamps_ns, poses)
    began_ns = time.process_time_ns()
    grid = OccupancyGrid()
    scans = [each.scan for each in recording.scans]
    for begin in range(0, count, _AT_ONCE):
        end = begin + _AT_ONCE
        grid.update_scans(estimate.poses[begin:end], scans[begin:end])
    grid_ms = 1e-6 * (time.process_time_ns() - began_ns)
    return LidarResult(
        recording,
        mapper,
        estimate,
        Trajectory.of(stamps_ns, online),
        grid,
        by_wheels,
        np.array(times_ms),
        grid_ms,
    )


def _compile(recording: Recording) -> None:
    """Have all kernels compiled before times are taken."""
    mapper = SlamMapper(LidarSlamConfig(keyframe_m=0.0))
    for _ in range(mapper.config.linked_keyframes + 2):
        mapper.add(recording.scans[0].scan, SE2())


def graph_of(mapper: SlamMapper) -> GraphFile:
    """Return the graph of the keyframes at the estimate, without links that are switched off."""
    back_end, build = mapper.back_end, GraphBuilder()
    build.variables(POSES, np.arange(len(back_end.poses)), back_end.poses)
    kept = [
        (link, weight)
        for link, weight in zip(back_end.links, back_end.weights, strict=True)
        if weight >= OFF
    ]
    if kept:
        build.factors(
            BETWEEN_2D,
            np.array([(link.first, link.second) for link, _ in kept]),
            np.array([as_row(link.pose) for link, _ in kept]),
            np.array([weight * link.information for link, weight in kept]),
        )
    return GraphFile(*build.build(), np.empty(0, np.int64))


def write_lidar_results(result: LidarResult, folder: Path) -> None:
    """Write the files of a result into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    write_tum(folder / "trajectory.tum", result.estimate)
    write_tum(folder / "online.tum", result.online)
    save_map(folder / "map", result.grid.map_rows(strays=_STRAYS))
    G2O.write(folder / "graph.g2o", graph_of(result.mapper))
    _write_closures(folder / "closures.csv", result.mapper)
    text = json.dumps(result.report(), indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")


def _write_closures(path: Path, mapper: SlamMapper) -> None:
    """Write what became of each loop that was looked at."""
    stamps = [each.stamp_ns for each in mapper.keyframes]

    def row(each: Closure) -> list[Any]:
        x, y, theta = as_row(each.pose).round(6).tolist()
        return [
            each.keyframe, each.other, stamps[each.keyframe], stamps[each.other], x, y, theta,
            round(each.score, 4), each.reason or "closed",
        ]  # fmt: skip

    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["keyframe", "other", "stamp_ns", "other_stamp_ns", "x_m", "y_m", "theta_rad", "score",
             "outcome"]
        )  # fmt: skip
        writer.writerows(map(row, mapper.loops.log))
