"""Monte Carlo localisation on public lidar logs: speed, accuracy, unknown start, carried away.

Maps are built from the even scans at their reference poses; the odd scans localise. Freiburg 079
and Seattle were corrected in place and have no odometry of their own: noise is put on their poses,
by which a robot is some 10 cm and 6 degrees off after a metre. In the museum visitors hide the
walls. All settings are the defaults but the number of particles. ROBOTCTL_DATA names the folder of
the recordings.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.logs.formats.carmen_log import read_carmen
from robotctl.logs.recorded_motion import increments, noisy
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.recording import RecordedScan
from robotctl.workbench.localise.mapping import choose_scans

LOGS = {
    "Intel": ("intel-odometry.log.gz", (0.0, 0.0)),
    "Freiburg 079": ("freiburg-079-corrected.log.gz", (0.1, 0.1)),
    "Seattle": ("seattle-corrected.log.gz", (0.1, 0.1)),
    "museum": ("fhw-odometry.log.gz", (0.0, 0.0)),
    "Acapulco": ("acapulco-odometry.log.gz", (0.0, 0.0)),
}
"""File, and noise put on its odometry [m after 1 m], [rad after 1 m and after 1 rad]."""
SEEDS_A_ROUND = 2
TRACKING, SEARCHING = 2000, 20_000
START_M, START_RAD = 0.25, 0.1
FIRST = 60
"""Scans in which a robot is to be found."""
FAR_M = 5.0
"""It is carried at least so far."""
NEAR_M, NEAR_RAD = 0.5, math.radians(20.0)
"""An estimate so near to the reference is right."""
STABLE = 10
"""A robot counts as found if so many last estimates are right."""
_GOALS = {2000: 0.6, 10_000: 3.0}


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A recorded drive with the map of its other half."""

    name: str
    scans: Sequence[RecordedScan]
    grid: GridMap
    field: LikelihoodField
    noise: tuple[float, float]


def load(name: str, folder: Path) -> Log:
    """Read a log and build the map of its even scans."""
    file, noise = LOGS[name]
    recording = read_carmen(folder / "carmen" / file)
    even = choose_scans(recording, "even")
    grid = OccupancyGrid()
    poses = [_row(entry.reference) for entry in even if entry.reference is not None]
    grid.update_scans(np.array(poses), [entry.scan for entry in even])
    chart = grid.to_map()
    return Log(name, choose_scans(recording, "odd"), chart, LikelihoodField(chart), noise)


def _row(pose: SE2) -> tuple[float, float, float]:
    return pose.x_m, pose.y_m, pose.theta_rad


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of a run, one row for each scan."""

    off_m: NDArray[np.float64]
    off_rad: NDArray[np.float64]
    sure: NDArray[np.bool_]
    """Whether the localiser claimed to be localised."""
    busy_s: float

    @property
    def right(self) -> NDArray[np.bool_]:
        """Which estimates are right."""
        return (self.off_m < NEAR_M) & (self.off_rad < NEAR_RAD)


def follow(
    mcl: MonteCarloLocaliser, log: Log, scans: Sequence[RecordedScan], deltas: Sequence[SE2]
) -> Errors:
    """Let the localiser go through scans, with the motion before each."""
    off, sure, busy_s = [], [], 0.0
    for entry, delta in zip(scans, deltas, strict=True):
        began = time.process_time()
        mcl.move(delta)
        if mcl.due():
            mcl.measure(log.field.measurement(entry.scan))
        estimate = mcl.estimate(entry.scan.stamp_ns)
        busy_s += time.process_time() - began
        assert entry.reference is not None
        error = entry.reference.inverse() @ estimate.pose
        off.append((math.hypot(error.x_m, error.y_m), abs(wrap_angle(error.theta_rad))))
        sure.append(estimate.status is LocalisationStatus.LOCALISED)
    off_m, off_rad = np.array(off).T
    return Errors(off_m, off_rad, np.array(sure), busy_s)


def motion(log: Log, scans: Sequence[RecordedScan], rng: np.random.Generator) -> list[SE2]:
    """Return the odometry before each scan."""
    return noisy(increments([entry.odometry for entry in scans]), log.noise, rng)


def localiser(log: Log, particles: int, rng: np.random.Generator) -> MonteCarloLocaliser:
    """Return a localiser that may use so many particles."""
    least = min(particles, MclConfig().min_particles)
    config = MclConfig(min_particles=least, max_particles=particles)
    return MonteCarloLocaliser(config, free_poses(log.grid), rng)


def start_at_reference(
    mcl: MonteCarloLocaliser, entry: RecordedScan, rng: np.random.Generator
) -> None:
    """Start where the robot is, known to within the start's uncertainty."""
    assert entry.reference is not None
    x, y, theta = rng.normal(_row(entry.reference), (START_M, START_M, START_RAD))
    mcl.start_at(SE2(x, y, wrap_angle(theta)), START_M, START_RAD)


def track(log: Log, seed: int) -> Errors:
    """Follow the whole log from a known start, with a fixed number of particles."""
    start_rng, motion_rng, mcl_rng = np.random.default_rng(seed).spawn(3)
    config = MclConfig(min_particles=TRACKING, max_particles=TRACKING)
    mcl = MonteCarloLocaliser(config, free_poses(log.grid), mcl_rng)
    start_at_reference(mcl, log.scans[0], start_rng)
    return follow(mcl, log, log.scans, motion(log, log.scans, motion_rng))


def find(log: Log, seed: int, *, anywhere: bool) -> Errors:
    """Search in the first scans of the log, or in as many after a random one."""
    start_rng, motion_rng, mcl_rng = np.random.default_rng(seed).spawn(3)
    begin = int(start_rng.integers(len(log.scans) - FIRST)) if anywhere else 0
    scans = log.scans[begin : begin + FIRST]
    mcl = localiser(log, SEARCHING, mcl_rng)
    return follow(mcl, log, scans, motion(log, scans, motion_rng))


def carry(log: Log, seed: int) -> tuple[Errors, Errors]:
    """Follow the log, be carried to another place of it, and search there."""
    start_rng, motion_rng, mcl_rng = np.random.default_rng(seed).spawn(3)
    middle = len(log.scans) // 2
    here = log.scans[middle - 1].reference
    far = [
        i
        for i, entry in enumerate(log.scans[:-FIRST])
        if here and entry.reference and _distance_m(here, entry.reference) > FAR_M
    ]
    there = int(start_rng.choice(far))
    mcl = localiser(log, SEARCHING, mcl_rng)
    start_at_reference(mcl, log.scans[0], start_rng)
    before, after = log.scans[:middle], log.scans[there : there + FIRST]
    first = follow(mcl, log, before, motion(log, before, motion_rng))
    # The first motion after it is none: wheels of a robot in the air stand still. One scan more
    # is due since the last, for the robot is set down.
    mcl.move(SE2(MclConfig().update_min_m, 0.0, 0.0))
    return first, follow(mcl, log, after, motion(log, after, motion_rng))


def _distance_m(a: SE2, b: SE2) -> float:
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


def run(rounds: int, _seconds: float) -> None:
    """Measure all on all logs."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    if not (folder / "carmen").is_dir():
        machine.note(f"localisation: not measured, no {folder / 'carmen'}; set ROBOTCTL_DATA")
        return
    logs = [load(name, folder) for name in LOGS]
    _speed(logs[0], rounds)
    seeds = range(rounds * SEEDS_A_ROUND)
    rows = [_track_row(log, [track(log, seed) for seed in seeds]) for log in logs]
    heads = ("log", "rmse m (seeds)", "greatest m", "heading deg", "right at all scans")
    title = f"Tracking: {TRACKING} particles, 60 beams, start known to {START_M} m, {START_RAD} rad"
    machine.table(f"{title}, {len(seeds)} seeds (Intel allowed: 0.075 m, 0.9 deg)", heads, rows)
    rows = []
    for log in logs:
        for anywhere in (False, True):
            runs = [find(log, seed, anywhere=anywhere) for seed in seeds]
            where = "random scans" if anywhere else "first scans"
            rows.append(_found_row(f"{log.name}, {where}", runs))
        pairs = [carry(log, seed) for seed in seeds]
        rows.append(_found_row(f"{log.name}, carried away", [after for _, after in pairs]))
    heads = ("log", "found", "after scans (seeds)", "wrongly sure, scans of 60", "CPU ms a scan")
    title = f"Unknown start, and carried away: {SEARCHING} particles, {FIRST} scans"
    machine.table(f"{title}, {len(seeds)} seeds (allowed: 9 of 10)", heads, rows)


def _track_row(log: Log, runs: list[Errors]) -> tuple[str, ...]:
    rms = [math.sqrt(float(np.mean(run.off_m**2))) for run in runs]
    heading = [math.degrees(math.sqrt(float(np.mean(run.off_rad**2)))) for run in runs]
    return (
        log.name,
        machine.spread(rms, 4),
        f"{max(run.off_m.max() for run in runs):.2f}",
        machine.spread(heading, 2),
        f"{sum(bool(run.right.all()) for run in runs)} of {len(runs)}",
    )


def _found_row(name: str, runs: list[Errors]) -> tuple[str, ...]:
    found = [run for run in runs if run.right[-STABLE:].all()]
    after = [int(np.max(np.flatnonzero(~run.right), initial=-1)) + 1 for run in found]
    return (
        name,
        f"{len(found)} of {len(runs)}",
        machine.spread(after, 0) if after else "never",
        f"{np.mean([np.count_nonzero(run.sure & ~run.right) for run in runs]):.1f}",
        machine.spread([1e3 * run.busy_s / FIRST for run in runs], 1),
    )


def _speed(log: Log, rounds: int) -> None:
    """Time motion, sensor and resampling on the tracked robot."""
    rows = []
    for particles, goal_ms in _GOALS.items():
        took = [_step_ms(log, particles, seed) for seed in range(rounds)]
        rows.append((f"{particles} x 60", machine.spread(took, 2), f"{goal_ms:g}"))
    heads = ("particles x beams", "CPU ms (rounds)", "goal")
    machine.table("A step: motion, likelihood field, weights, resampling, estimate", heads, rows)


def _step_ms(log: Log, particles: int, seed: int) -> float:
    """Return the median time of a step on the first half of a log [ms]."""
    rng = np.random.default_rng(seed)
    config = MclConfig(min_particles=particles, max_particles=particles)
    mcl = MonteCarloLocaliser(config, free_poses(log.grid), rng)
    start_at_reference(mcl, log.scans[0], rng)
    scans = log.scans[: len(log.scans) // 2]
    took = []
    for entry, delta in zip(scans, motion(log, scans, rng), strict=True):
        measurement = log.field.measurement(entry.scan)
        began = time.process_time_ns()
        mcl.move(delta)
        mcl.measure(measurement)
        mcl.estimate(entry.scan.stamp_ns)
        took.append(1e-6 * (time.process_time_ns() - began))
    return machine.median(took)
