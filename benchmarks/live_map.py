"""What navigation does with each scan: live map, tracks and guard, beside a plain peer.

The peer keeps the same map with numpy and scipy: points along all beams are cleared, end points are
marked, and the distance transform of the whole map is taken anew.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.planning_map import clearance_of
from robotctl.planning.map.tracks import MovingObstacles

SIDE_M = 0.05
LOW, HIGH = (-25.0, -20.0), (25.0, 20.0)
BODY = Footprint(((0.2, -0.18), (0.2, 0.18), (-0.2, 0.18), (-0.2, -0.18)))
REACH_M, MAX_RANGE_M = 4.0, 12.0
STEPS = 100


def run(rounds: int, _seconds: float) -> None:
    """Measure a robot that drives 2 m among columns, 100 scans."""
    rows = []
    for beams in (360, 1000):
        scans = _scans(beams)
        for name, work in (
            ("live map: scan, and window of 8 x 8 m", _live),
            ("peer: the same, with the whole map", _peer),
            ("window of 8 x 8 m, unchanged", _window),
            ("tracks", _tracks),
            ("guard: 20 arcs", _guard),
        ):
            step = work(scans)
            times = []
            for number in range(rounds + 1):
                taken = []
                for k, (pose, scan) in enumerate(scans):
                    began = time.process_time()
                    step(pose, scan, (number * STEPS + k + 1) * 100_000_000)
                    taken.append(1e3 * (time.process_time() - began))
                if number:  # the first compiles, and fills the map
                    times += taken
            tail = f"{np.percentile(times, 99):.2f}"
            rows.append((str(beams), name, f"{machine.median(times):.3f}", tail))
    heads = ("beams", "work", "median ms", "99 % ms")
    machine.table("Each scan, a map of 50 m x 40 m at 0.05 m: processor time", heads, rows)


def _scans(beams: int) -> list[tuple[SE2, RangeScan]]:
    """Return poses and scans, with 1 cm of noise."""
    rng = np.random.default_rng(1)
    columns = np.column_stack([rng.uniform(-10, 10, (60, 2)), rng.uniform(0.1, 0.4, 60)])
    columns = columns[np.abs(columns[:, 1]) > 0.8]
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    scans = []
    for k in range(STEPS):
        pose = SE2(0.02 * k, 0.0, 0.02 * math.sin(0.1 * k))
        ahead = np.stack([np.cos(angles + pose.theta_rad), np.sin(angles + pose.theta_rad)], 1)
        to = columns[:, :2] - (pose.x_m, pose.y_m)
        along = ahead @ to.T
        depth = columns[:, 2] ** 2 - ((to**2).sum(axis=1) - along**2)
        hit = (depth > 0.0) & (along > 0.0)
        away = np.where(hit, along - np.sqrt(np.maximum(depth, 0.0)), np.inf).min(axis=1)
        away += rng.normal(0.0, 0.01, beams)
        away[away > MAX_RANGE_M] = np.inf
        scans.append((pose, RangeScan(0, angles, away, MAX_RANGE_M)))
    return scans


Step = Callable[[SE2, RangeScan, int], object]


def _live(_scans: object) -> Step:
    live = LayeredMap.without_map(LOW, HIGH, SIDE_M, BODY)

    def step(pose: SE2, scan: RangeScan, now_ns: int) -> None:
        live.see_scan(pose, scan, now_ns)
        live.space_around(pose, REACH_M)

    return step


def _window(scans: list[tuple[SE2, RangeScan]]) -> Step:
    live = LayeredMap.without_map(LOW, HIGH, SIDE_M, BODY)
    live.see_scan(*scans[0], 1)
    live.space()
    return lambda pose, _scan, _now_ns: live.space_around(pose, REACH_M)


def _peer(_scans: object) -> Step:
    shape = tuple(round((HIGH[i] - LOW[i]) / SIDE_M) for i in (1, 0))
    blocked = np.zeros(shape, np.bool_)

    def cells(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], ...]:
        return tuple(np.floor((points - LOW) / SIDE_M).astype(np.int64).T[::-1])

    def step(pose: SE2, scan: RangeScan, _now_ns: int) -> None:
        angles = scan.angles_rad + pose.theta_rad
        ahead = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        for direction, away in zip(ahead, scan.ranges_m, strict=True):
            along = np.arange(0.0, min(away, 10.0) - SIDE_M, SIDE_M)
            blocked[cells((pose.x_m, pose.y_m) + along[:, np.newaxis] * direction)] = False
        hit = scan.ranges_m < 10.0
        points = (pose.x_m, pose.y_m) + scan.ranges_m[hit, np.newaxis] * ahead[hit]
        blocked[cells(points)] = True
        clearance_of(blocked)

    return step


def _tracks(_scans: object) -> Step:
    obstacles = MovingObstacles()

    def step(pose: SE2, scan: RangeScan, now_ns: int) -> None:
        obstacles.step(pose, scan, now_ns)
        obstacles.moving(SE2())

    return step


def _guard(_scans: object) -> Step:
    guard = ObstacleGuard(GuardConfig(), ())

    def step(_pose: SE2, scan: RangeScan, _now_ns: int) -> None:
        guard.observe((), (), (), scan.points_base())
        for k in range(20):
            guard.step(0.3, 0.05 * (k - 10))

    return step
