"""Occupancy grid on public lidar logs, at 0.05 m: processor time for a scan, and how well the map
of the even scans foretells the odd ones, all at the logs' reference poses.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks import machine
from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.logs.formats.carmen_log import read_carmen
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan

LOGS = {
    "Intel": "intel-odometry.log.gz",
    "Freiburg 079": "freiburg-079-corrected.log.gz",
    "Seattle": "seattle-corrected.log.gz",
}
PEER_US, GOAL_US = 13.5, 13.0
"""MRPT's figure for a scan of 180 beams on a like machine, and what is wanted [us]."""
_SINGLE = 200


def run(rounds: int, seconds: float) -> None:
    """Measure whole logs into an empty grid, scan by scan, and ray by ray as textbooks have it."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", "")) / "carmen"
    rows, quality = [], []
    for name, file in LOGS.items():
        if not (folder / file).is_file():
            machine.note(f"{name}: not measured, there is no {folder / file}; see ROBOTCTL_DATA")
            continue
        recording = read_carmen(folder / file)
        references = [each.reference for each in recording.scans if each.reference is not None]
        poses = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in references])
        scans = [each.scan for each in recording.scans]
        rows.append(_row(name, poses, scans, rounds))
        quality.append(_agreement(name, poses, scans))
    heads = ("log", "scans", "beams", "batched us", "one by one us", "ray by ray us")
    machine.table(f"Occupancy grid, a scan: goal {GOAL_US:g}, MRPT {PEER_US:g} us", heads, rows)
    heads = (
        "log",
        "walls of the odd in the even map",
        "and back",
        "odd echoes",
        "odd walls free in the even map",
    )
    machine.table("Agreement of the halves of a log, within a cell", heads, quality)


def _row(
    name: str, poses: NDArray[np.float64], scans: Sequence[RangeScan], rounds: int
) -> tuple[str, ...]:
    """Measure one log."""
    grid, walked = OccupancyGrid(), _Rays(poses, scans)

    def batched() -> None:
        grid.reset()
        grid.update_scans(poses, scans)

    def singly() -> None:
        for pose, scan in zip(poses[:_SINGLE], scans[:_SINGLE], strict=True):
            grid.update_scan(SE2(*pose), scan)

    times: list[list[float]] = [[], [], []]
    for number in range(3 * rounds + 1):
        for kept, work in zip(times, (batched, singly, walked.add), strict=True):
            taken_s = _cpu_s(work)
            if number > 0:  # the first compiles
                kept.append(1e6 * taken_s / (_SINGLE if work is singly else len(scans)))
    return (
        name,
        str(len(scans)),
        str(len(scans[0].ranges_m)),
        *(machine.spread(kept, 1) for kept in times),
    )


def _agreement(
    name: str, poses: NDArray[np.float64], scans: Sequence[RangeScan]
) -> tuple[str, ...]:
    """Compare the maps of the two halves of a log, and the scans of one with the map of the other.

    The last figure is the share of the odd map's occupied cells that the even one has as free.
    """
    maps, grids = [], (OccupancyGrid(), OccupancyGrid())
    for half, grid in enumerate(grids):
        grid.update_scans(poses[half::2], scans[half::2])
        maps.append(grid.to_map())
    even, odd = maps
    walls = [each.centre_of(np.argwhere(each.occupied())) for each in maps]
    cells = even.cell_of(walls[1])
    inside = np.all((cells >= 0) & (cells < even.cells.shape), axis=1)
    free = even.free()[tuple(cells[inside].T)].sum() / len(cells)
    shares = (
        _near(even, walls[1]),
        _near(odd, walls[0]),
        _near(even, _in_world(poses[1::2], scans[1::2])),
        free,
    )
    return (name, *(f"{100.0 * share:.1f} %" for share in shares))


def _cpu_s(work: Callable[[], None]) -> float:
    """Return the processor time of some work [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def _near(grid: GridMap, points: NDArray[np.float64]) -> float:
    """Return the share of points in, or one cell from, an occupied cell."""
    wide = ndimage.binary_dilation(np.pad(grid.occupied(), 1), np.ones((3, 3), np.bool_))
    cells = grid.cell_of(points) + 1
    inside = np.all((cells >= 0) & (cells < wide.shape), axis=1)
    return float(wide[tuple(cells[inside].T)].sum() / len(points))


def _in_world(poses: NDArray[np.float64], scans: Sequence[RangeScan]) -> NDArray[np.float64]:
    """Return the echoes of scans, (n, 2) [m]."""
    parts = []
    for (x, y, theta), scan in zip(poses, scans, strict=True):
        c, s = np.cos(theta), np.sin(theta)
        parts.append(scan.points_base() @ np.array([[c, s], [-s, c]]) + (x, y))
    return np.concatenate(parts)


class _Rays:
    """The same scans ray by ray into a grid that is large enough, cells counted for each beam."""

    def __init__(self, poses: NDArray[np.float64], scans: Sequence[RangeScan]) -> None:
        config = OccupancyGridConfig()
        self._steps = config.steps(config.hit), config.steps(config.miss)
        ranges = np.array([scan.ranges_m for scan in scans])
        self._echo = np.isfinite(ranges) & (ranges < scans[0].max_range_m)
        lengths = np.where(self._echo, ranges, np.where(np.isinf(ranges), config.no_echo_m, 0.0))
        angles = poses[:, 2:] + scans[0].angles_rad
        self._begin = poses[:, :2] / config.resolution_m
        ends = np.stack([np.cos(angles), np.sin(angles)], axis=2) * lengths[:, :, None]
        self._ends = ends / config.resolution_m + self._begin[:, None]
        corner = np.floor(self._ends.min(axis=(0, 1))) - 2.0
        self._begin = np.floor(self._begin - corner).astype(np.int64)
        self._ends = np.floor(self._ends - corner).astype(np.int64)
        columns, rows = self._ends.max(axis=(0, 1)) + 3
        self._cells = np.zeros((int(rows), int(columns)), np.int8)

    def add(self) -> None:
        """Add all scans."""
        _walk_rays(self._cells, self._begin, self._ends, self._echo, *self._steps)


@numba.njit(cache=True, error_model="numpy")
def _walk_rays(cells, begins, ends, echo, hit, miss):
    """Walk along each ray with Bresenham's algorithm."""
    for k in range(len(begins)):
        for i in range(ends.shape[1]):
            x, y = begins[k]
            end_x, end_y = ends[k, i]
            dx, dy = abs(end_x - x), -abs(end_y - y)
            step_x, step_y = (1 if end_x > x else -1), (1 if end_y > y else -1)
            error = dx + dy
            while x != end_x or y != end_y:
                cells[y, x] = max(cells[y, x] - miss, -127)
                twice = 2 * error
                if twice >= dy:
                    error += dy
                    x += step_x
                if twice <= dx:
                    error += dx
                    y += step_y
            if echo[k, i]:
                cells[y, x] = min(cells[y, x] + hit, 127)
