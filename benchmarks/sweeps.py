"""SLAM and localisation by a lidar that sweeps while the robot turns, unwound or not.

A drawn building of four rooms of boxes; the robot drives round it at 0.5 m/s, weaving and
turning on the spot at a given rate. The simulated lidar measures each of its 360 beams from where
it is at that time, ten turns a second. Odometry comes 50 times a second, with 3 % of noise on each
step and a turn of 0.01 rad a metre of its own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from firmware_sim.config.parameters import LidarParameters
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.world.world import World
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.ranging.unwinding import unwound
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory
from robotctl.model.wall_map import WallMap
from robotctl.model.world_map import WorldMap
from robotctl.workbench.localise.mcl import run_mcl
from robotctl.workbench.localise.options import LocaliseOptions
from robotctl.workbench.slam.scans import scan_slam_of

RATES_RAD_S = (0.5, 1.0, 2.0)
SEEDS = 2
SWEEP_S = 0.1
WALLS = np.array(
    [
        *((0, 0, 16, 0), (16, 0, 16, 12), (16, 12, 0, 12), (0, 12, 0, 0)),
        *((3, 3, 7, 3), (7, 3, 7, 5), (7, 5, 3, 5), (3, 5, 3, 3)),
        *((10, 3, 13, 3), (13, 3, 13, 6), (13, 6, 10, 6), (10, 6, 10, 3)),
        *((3, 8, 5, 8), (5, 8, 5, 9.5), (5, 9.5, 3, 9.5), (3, 9.5, 3, 8)),
        *((8, 8.5, 13, 8.5), (13, 8.5, 13, 9.5), (13, 9.5, 8, 9.5), (8, 9.5, 8, 8.5)),
        *((0, 6.5, 1, 6.5), (15.2, 4, 16, 4), (9, 0, 9, 0.6), (6, 12, 6, 11.3)),
    ],
    dtype=float,
)
LEGS_M = (12.4, 9.0, 12.4, 9.0)
_TICK_S = 0.002
_V_M_S = 0.5
_WEAVE_RAD = 0.35


def commands(rate_rad_s: float) -> Iterator[tuple[float, float, float]]:
    """Yield speed [m/s], turning rate [rad/s] and duration [s] of a round."""
    swing_s = _TICK_S * round(_WEAVE_RAD / rate_rad_s / _TICK_S)  # else it leaves its line
    for length_m in LEGS_M:
        # A weave has the heading of the leg at both ends, and comes back to its line.
        along_m = 4.0 * _V_M_S * math.sin(_WEAVE_RAD) / rate_rad_s
        weaves = int(length_m / along_m)
        for _ in range(weaves):
            for sense, swings in ((1.0, 1.0), (-1.0, 2.0), (1.0, 1.0)):
                yield _V_M_S, sense * rate_rad_s, swings * swing_s
        yield _V_M_S, 0.0, (length_m - weaves * along_m) / _V_M_S
        yield 0.0, rate_rad_s, 0.5 * math.pi / rate_rad_s


def driven(rate_rad_s: float) -> NDArray[np.float64]:
    """Return the true poses every `_TICK_S`, (n, 3)."""
    pose, poses = SE2(1.8, 1.5, 0.0), []
    for v, omega, duration_s in commands(rate_rad_s):
        step = SE2.exp(v * _TICK_S, 0.0, omega * _TICK_S)
        for _ in range(round(duration_s / _TICK_S)):
            poses.append((pose.x_m, pose.y_m, pose.theta_rad))
            pose = pose @ step
    return np.array(poses)


def odometry_of(poses: NDArray[np.float64], rng: np.random.Generator) -> list[SE2]:
    """Return what the wheels say of poses."""
    true = [SE2(*row) for row in poses.tolist()]
    said = [SE2()]
    for before, now in itertools.pairwise(true):
        step = before.inverse() @ now
        way_m, noise = math.hypot(step.x_m, step.y_m), 1.0 + 0.03 * rng.standard_normal(2)
        turn = math.remainder(step.theta_rad, math.tau) * noise[1] + 0.01 * way_m
        said.append(said[-1] @ SE2(step.x_m * noise[0], step.y_m * noise[0], turn))
    return said


def recorded(rate_rad_s: float, sweep_s: float, seed: int) -> Recording:
    """Return a drive; its scans say that they sweep."""
    rng, poses = np.random.default_rng(seed), driven(rate_rad_s)
    lidar = Lidar(
        LidarParameters(sweep_s=SWEEP_S), World.from_segments(WALLS.tolist()), rng.spawn(1)[0]
    )
    every = round(0.02 / _TICK_S)
    stamps_ns = (1e9 * _TICK_S * np.arange(0, len(poses), every)).astype(np.int64)
    odometry = Trajectory.of(stamps_ns, odometry_of(poses[::every], rng))
    ticks, scans, headings = np.arange(len(poses)), [], np.unwrap(poses[:, 2])
    for tick in range(round(SWEEP_S / _TICK_S), len(poses) - every, round(0.1 / _TICK_S)):
        at = tick - (lidar.ages_s if sweep_s else np.zeros(360)) / _TICK_S
        beams = [np.interp(at, ticks, each) for each in (poses[:, 0], poses[:, 1], headings)]
        stamp_ns = round(1e9 * _TICK_S * tick)
        scan = RangeScan(
            stamp_ns, lidar.angles_rad, lidar.sweep(np.stack(beams, axis=1)), 12.0, sweep_s=sweep_s
        )
        wheels = odometry.at(stamp_ns)
        if wheels is not None:
            scans.append(RecordedScan(scan, wheels, SE2(*poses[tick].tolist())))
    reference = Trajectory.of(
        [each.scan.stamp_ns for each in scans], [each.reference or SE2() for each in scans]
    )
    return Recording("drive", tuple(scans), odometry, reference=reference)


def off_walls(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of points (n, 2) from the nearest wall [m]."""
    a, e = WALLS[:, :2], WALLS[:, 2:] - WALLS[:, :2]
    d = points[:, None] - a
    share = np.clip((d * e).sum(axis=2) / (e**2).sum(axis=1), 0.0, 1.0)
    result: NDArray[np.float64] = np.hypot(*np.moveaxis(d - share[..., None] * e, 2, 0)).min(axis=1)
    return result


def slam_row(recording: Recording) -> tuple[float, float, float, str]:
    """Return the errors of poses and of echoes, RMS and 95 % [m], and the verdict."""
    result = scan_slam_of(recording, lambda *_: None)
    true = np.array([(p.x_m, p.y_m) for each in recording.scans if (p := each.reference)])
    T_world_map = align(result.estimate.poses[:, :2], true)
    off_m = np.hypot(*(moved(T_world_map, result.estimate.poses[:, :2]) - true).T)
    points = [
        moved(T_world_map @ SE2(*pose), each.scan.points_base()[::8])
        for each, pose in zip(
            result.recording.scans[::5], result.estimate.poses[::5].tolist(), strict=True
        )
    ]
    echoes_m = off_walls(np.concatenate(points))
    quality = "" if result.verdict is None else result.verdict.quality.value
    return (
        float(np.sqrt(np.mean(off_m**2))),
        float(np.sqrt(np.mean(echoes_m**2))),
        float(np.quantile(echoes_m, 0.95)),
        quality,
    )


def mcl_row(recording: Recording, seed: int) -> tuple[float, float]:
    """Return the RMS error of position [m] and heading [deg] on the map of the walls."""
    walls = WallMap(WALLS)
    run = run_mcl(
        recording,
        LocaliseOptions(Path("drive"), map="walls"),
        WorldMap(grid_of_walls(walls), walls),
        np.random.default_rng(seed),
        lambda *_: None,
    )
    truth = [each.reference for each in recording.scans if each.reference]
    off = [true.inverse() @ each.pose for each, true in zip(run.estimates, truth, strict=True)]
    away = np.array(
        [(each.x_m, each.y_m, math.remainder(each.theta_rad, math.tau)) for each in off]
    )
    return float(np.sqrt((away[:, :2] ** 2).sum(axis=1).mean())), math.degrees(
        float(np.sqrt((away[:, 2] ** 2).mean()))
    )


def variants(rate_rad_s: float, seed: int) -> Iterator[tuple[str, Recording]]:
    """Yield a drive with a lidar of one instant, with a sweep as it is, and unwound."""
    yield "one instant", recorded(rate_rad_s, 0.0, seed)
    swept = recorded(rate_rad_s, SWEEP_S, seed)
    odometry = swept.odometry
    assert odometry is not None
    yield (
        "sweep",
        replace(
            swept, scans=tuple(replace(e, scan=replace(e.scan, sweep_s=0.0)) for e in swept.scans)
        ),
    )
    yield (
        "unwound",
        replace(
            swept, scans=tuple(replace(e, scan=unwound(e.scan, odometry.at)) for e in swept.scans)
        ),
    )
    alone = [replace(e, odometry=e.reference or SE2()) for e in swept.scans]
    as_is = [replace(e, scan=replace(e.scan, sweep_s=0.0)) for e in alone]
    yield "no odometry, sweep", replace(swept, scans=tuple(as_is))
    yield "no odometry, unwound", replace(swept, scans=tuple(alone))


def run(_rounds: int, _seconds: float) -> None:
    """Measure all."""
    heads = ("scans", "poses, m", "echoes, m", "95 %, m", "verdict", "mcl, m", "mcl, deg")
    for rate in RATES_RAD_S:
        found: dict[str, list[tuple[float, ...]]] = {}
        verdicts: dict[str, list[str]] = {}
        for seed in range(SEEDS):
            for name, recording in variants(rate, seed):
                *figures, quality = slam_row(recording)
                if not name.startswith("no "):
                    figures += mcl_row(recording, seed)
                found.setdefault(name, []).append(tuple(figures))
                verdicts.setdefault(name, []).append(quality)
        rows = []
        for name, each in found.items():
            means = [f"{value:.4f}" for value in np.mean(each, axis=0)] + 2 * ["-"]
            rows.append((name, *means[:3], ", ".join(verdicts[name]), *means[3:5]))
        machine.table(f"Sweeps of {SWEEP_S} s at {rate:g} rad/s, {SEEDS} drives", heads, rows)
