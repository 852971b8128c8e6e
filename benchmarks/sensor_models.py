"""Sensor models of the localiser: processor time, exact rays beside the classic traversal, and
what the constants of the models rest on: mixtures and correlations of beams on public lidar logs.

Maps of the logs are those of their even scans, at 0.05 m; what is learned is learned from the odd
scans at their reference poses. ROBOTCTL_DATA names the folder of the recordings.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from benchmarks.localisation_accuracy import LOGS, Log, load
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.ranging.beam_selection import evenly_chosen
from robotctl.estimation.ranging.likelihood_config import LikelihoodFieldConfig
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.estimation.ranging.range_mixture import BeamMixture, learned
from robotctl.estimation.ranging.sonar_model import SonarModel
from robotctl.maps.map_file import load_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.wall_map import WallMap

MAPS = ("tb3_sandbox", "warehouse")
BEAMS = 60
NEAR = (0.1, 0.1, 0.05)
"""Standard deviations of the poses of a robot that is localised [m, m, rad]."""
FAR_M = 80.0
_REPEATS = 10


def run(rounds: int, _seconds: float) -> None:
    """Measure all."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    _sonars(rounds)
    if not (folder / "carmen").is_dir():
        machine.note(f"lidar models: not measured, no {folder / 'carmen'}; set ROBOTCTL_DATA")
        return
    logs = [load(name, folder) for name in LOGS]
    _scans(logs[0], rounds)
    maps = {f"{logs[0].name}, 0.05 m": logs[0].grid}
    maps |= {name: load_map(folder / "maps" / f"{name}.yaml") for name in MAPS}
    _rays(maps, rounds)
    heads = ("log", "hit", "short", "none", "random", "sigma m", "offset m")
    rows = [_learned_row(log) for log in logs]
    machine.table("Mixture learned from the odd scans in the map of the even ones", heads, rows)
    heads = ("log", *(f"{n} beams: correlation, worth" for n in (30, 60, 180)))
    rows = [(log.name, *(_correlation(log, n) for n in (30, 60, 180))) for log in logs]
    machine.table("Log-likelihoods of beams at the reference poses", heads, rows)


def _cpu_ms(work: Callable[[], object], rounds: int) -> list[float]:
    """Return the processor time of one call in each round, without the first call."""
    work()
    found = []
    for _ in range(rounds):
        began = time.process_time()
        for _ in range(_REPEATS):
            work()
        found.append(1e3 * (time.process_time() - began) / _REPEATS)
    return found


def _weigh(model, reading, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return model.measurement(reading)(poses)


def _poses(log: Log, n: int, rng: np.random.Generator, *, near: bool) -> NDArray[np.float64]:
    """Return poses about one reference, or about all with any heading."""
    reference = np.array(
        [(e.reference.x_m, e.reference.y_m, e.reference.theta_rad) for e in log.scans]
    )
    if near:
        return reference[len(reference) // 4] + rng.normal(size=(n, 3)) * NEAR
    chosen = reference[rng.integers(len(reference), size=n)]
    return chosen + rng.normal(size=(n, 3)) * (0.2, 0.2, 3.0)


def _scans(log: Log, rounds: int) -> None:
    rng = np.random.default_rng(1)
    scan = log.scans[len(log.scans) // 4].scan
    rows = []
    for n in (2000, 10_000):
        times = []
        for near in (True, False):
            poses = _poses(log, n, rng, near=near)
            times.append(_cpu_ms(partial(_weigh, log.field, scan, poses), rounds))
        rows.append((f"likelihood field, {n} × {BEAMS}", *(machine.spread(t, 3) for t in times)))
    heads = ("weighing", "poses near each other, ms (rounds)", "poses all over the map, ms")
    machine.table(f"Weighing a scan on the {log.name} map (allowed: 0.15 ms)", heads, rows)


def _rays(maps: dict[str, GridMap], rounds: int) -> None:
    rows = []
    rng = np.random.default_rng(2)
    for name, grid in maps.items():
        rows_free, columns_free = np.nonzero(grid.free())
        chosen = rng.integers(len(rows_free), size=2000)
        cells = np.stack([rows_free[chosen], columns_free[chosen]], axis=1)
        poses = np.column_stack([grid.centre_of(cells), rng.uniform(-math.pi, math.pi, 2000)])
        near = poses[0] + rng.normal(size=(2000, 3)) * NEAR
        caster, angles = RangeCaster(grid), np.linspace(-1.5, 1.5, BEAMS)
        close = _cpu_ms(partial(caster.cast, near, angles, FAR_M), rounds)
        ours = _cpu_ms(partial(caster.cast, poses, angles, FAR_M), rounds)
        classic = _cpu_ms(partial(traversal, grid, poses, angles), rounds)
        other, found = traversal(grid, poses, angles), caster.cast(poses, angles, FAR_M)
        hit = np.isfinite(found)
        assert np.array_equal(hit, np.isfinite(other))
        off = np.abs(found[hit] - other[hit]).max()
        speed = [[2.0 * BEAMS / ms for ms in times] for times in (close, ours, classic)]
        in_cells = f"{found[hit].mean() / grid.resolution_m:.0f}"
        rows.append((name, in_cells, *(machine.spread(s, 1) for s in speed), f"{off:.0e}"))
    heads = ("map", "cells a ray", "near poses", "all over", "cell by cell, all over", "differ m")
    machine.table("Exact rays, million/s (rounds); peers: DDA 8, pruned CDDT 15", heads, rows)


def traversal(
    grid: GridMap, poses: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cast rays cell by cell (Amanatides and Woo 1987), compiled too; the map is not turned."""
    ranges = np.empty((len(angles), len(poses)))
    stops = np.pad(grid.occupied(), 1, constant_values=True)
    at = poses.copy()
    at[:, :2] = (poses[:, :2] - [grid.origin.x_m, grid.origin.y_m]) / grid.resolution_m
    _traverse(at, angles, stops, ranges)
    return ranges * grid.resolution_m


@numba.njit(error_model="numpy")
def _traverse(poses, angles, stops, ranges):
    rows, columns = stops.shape
    for k in range(len(angles)):
        for i in range(len(poses)):
            u, v = poses[i, 0] + 1.0, poses[i, 1] + 1.0
            du, dv = math.cos(poses[i, 2] + angles[k]), math.sin(poses[i, 2] + angles[k])
            column, row = int(u), int(v)
            step_u, step_v = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
            per_u, per_v = abs(1.0 / du), abs(1.0 / dv)
            next_u = per_u * (column + 1 - u if du > 0.0 else u - column)
            next_v = per_v * (row + 1 - v if dv > 0.0 else v - row)
            t = 0.0
            while not stops[row, column]:
                if next_u <= next_v:
                    t = next_u
                    next_u += per_u
                    column += step_u
                else:
                    t = next_v
                    next_v += per_v
                    row += step_v
            outside = column in {0, columns - 1} or row in {0, rows - 1}
            ranges[k, i] = np.inf if outside else t


def _sonars(rounds: int) -> None:
    mounts = load_robot(find_file("diff_drive")).sonar
    rng = np.random.default_rng(3)
    rows = []
    for name in ("flat", "office"):
        walls = WallMap(np.ascontiguousarray(load_world(find_file(name, "worlds")).segments))
        low_x, low_y, high_x, high_y = walls.bounds
        spread = rng.uniform((low_x, low_y, -3.0), (high_x, high_y, 3.0), (2000, 3))
        near = np.array([2.0, 1.5, 0.5]) + rng.normal(size=(2000, 3)) * NEAR
        reading = np.full(len(mounts), np.nan)
        reading[:4] = 1.0
        for kind, room in (("walls", walls), ("cells", grid_of_walls(walls))):
            model = SonarModel(room, mounts)
            times = [
                _cpu_ms(partial(_weigh, model, reading, poses), rounds) for poses in (near, spread)
            ]
            size = len(walls.segments)
            rows.append((f"{name} ({size} walls), {kind}", *(machine.spread(t, 2) for t in times)))
    heads = ("room", "poses near each other, ms (rounds)", "poses all over, ms")
    machine.table("Weighing four sonars, 2000 poses", heads, rows)


def _learned_row(log: Log) -> tuple[str, ...]:
    caster = RangeCaster(log.grid)
    expected, measured = [], []
    for entry in log.scans:
        scan, pose = entry.scan, entry.reference
        chosen = np.arange(0, len(scan.ranges_m), 3)
        sensor = pose @ SE2(scan.x_m, scan.y_m)
        at = np.array([[sensor.x_m, sensor.y_m, sensor.theta_rad]])
        expected.append(caster.cast(at, scan.angles_rad[chosen], scan.max_range_m)[:, 0])
        measured.append(scan.ranges_m[chosen])
    far_m = log.scans[0].scan.max_range_m
    found = learned(
        BeamMixture(), np.concatenate(expected), np.concatenate(measured), far_m, iterations=100
    )
    shares = (found.hit, found.short, found.none, found.random)
    shapes = (found.sigma_m, found.offset_m)
    return (log.name, *(f"{value:.3f}" for value in (*shares, *shapes)))


def _correlation(log: Log, beams: int) -> str:
    """Return the correlation of beams, and how many independent ones they are worth."""
    config = LikelihoodFieldConfig(beams=1, beam_correlation=0.0)
    field = LikelihoodField(log.grid, config)
    logs = []
    for entry in log.scans:
        scan, pose = entry.scan, entry.reference
        chosen = evenly_chosen(scan.ranges_m < scan.max_range_m, beams)
        if len(chosen) == beams:
            at = np.array([[pose.x_m, pose.y_m, pose.theta_rad]])
            logs.append([field.log_likelihood(at, _single(scan, i)).item() for i in chosen])
    table = np.array(logs)
    effect = table.sum(axis=1).var() / (beams * table.var())
    return f"{(effect - 1) / (beams - 1):.3f}, {beams / effect:.1f}"


def _single(scan: RangeScan, beam: int) -> RangeScan:
    part = slice(beam, beam + 1)
    return replace(scan, angles_rad=scan.angles_rad[part], ranges_m=scan.ranges_m[part])
