"""How often calibration's 95 % intervals hold the true robot: simulated squares, many seeds.

The robot drives Borenstein's square of 2 m both ways five times and a straight of 4 m three times,
steered by its own odometry. What its wheels really do is drawn: radii wrong by up to 3 % each,
track or wheelbase by 5 %, a steering that stands up to 0.03 rad beside its zero; rolling noise as
floor_noise and floor_length_m of the robot's file make it; a robot placed and a tape read with
errors. First kinematics alone, for 100 seeds; then the whole simulated robot in lockstep, with
motors, slip and controller, for a few.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.odometry.calibration import Calibration, calibrate
from robotctl.estimation.odometry.fit import Reference
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun, poses_at
from robotctl.model.drives.drives import Drive
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.odometry.calibrate_squares import Campaign

ROBOTS = ("diff_drive", "tricycle", "ackermann")
SEEDS, FULL_SEEDS = 100, 5
SIDE_M, RADIUS_M, STRAIGHT_M = 2.0, 0.6, 4.0
SQUARES, STRAIGHTS = 5, 3
TAPE_M, PLACED_RAD = 0.002, math.radians(0.5)
ROLLING_VARIANCE_M = 2.0 * 0.002**2 * 0.05
"""Of each wheel's way per metre [m^2/m], with the floor of the shipped robots."""

_STEP_M, _PERIOD_S = 0.02, 0.05


def way(turns: float) -> NDArray[np.float64]:
    """Return the moves (n, 3) of a straight, or of a square to the left (+1) or right (-1)."""
    if turns == 0.0:
        pieces = [(STRAIGHT_M, 0.0)]
    else:
        quarter = 0.5 * math.pi
        pieces = 4 * [(SIDE_M - 2.0 * RADIUS_M, 0.0), (RADIUS_M * quarter, turns * quarter)]
    steps = [(round(d / _STEP_M), d, a) for d, a in pieces]
    return np.concatenate([np.tile([d / n, a / n, 0.0], (n, 1)) for n, d, a in steps])


def true_change(model: OdometryModel, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw how the true robot differs from its file, (size,)."""
    if "wheel_radius_ratio" in model.keys:
        left, right = 1.0 + rng.uniform(-0.03, 0.03, 2)
        track = 1.0 + rng.uniform(-0.05, 0.05)
        return np.log([0.5 * (left + right), right / left, track])
    radius, length = 1.0 + rng.uniform([-0.03, -0.05], [0.03, 0.05])
    change = [math.log(radius), math.log(length)]
    return np.array(change + [rng.uniform(-0.03, 0.03) for _ in model.keys[2:]])


def driven(
    model: OdometryModel, true: Drive, moves: NDArray[np.float64], rng: np.random.Generator
) -> OdometryRun:
    """Return a run: wheels that turned as `moves` ask, and where the tape says it ended."""
    wheels = model.rolled(moves)
    rolled = wheels.copy()
    for i, radius_m in enumerate(true.wheel_radii_m):
        sigma_m = np.sqrt(ROLLING_VARIANCE_M * np.abs(wheels[:, i]) * radius_m)
        rolled[:, i] += sigma_m / radius_m * rng.standard_normal(len(wheels))
    stamps_s = _PERIOD_S * np.arange(len(wheels) + 1)
    sigma = (TAPE_M, TAPE_M, PLACED_RAD)
    run = OdometryRun("run", stamps_s, wheels, stamps_s[-1:], np.zeros((1, 3)), SE2(), sigma)
    placed = SE2(*(np.array(sigma) * rng.standard_normal(3)).tolist())
    end = poses_at(run, true.forward_many(rolled), placed, stamps_s[-1:])
    end[0, :2] += TAPE_M * rng.standard_normal(2)
    end[0, 2] = math.nan
    return dataclasses.replace(run, reference=end)


def calibrated(nominal: Drive, seed: int) -> tuple[NDArray[np.float64], Calibration]:
    """Return the true change of a drawn robot and what calibration says of it."""
    rng, model = np.random.default_rng(seed), OdometryModel(nominal)
    change = true_change(model, rng)
    true = model.drive(change)
    shapes = STRAIGHTS * [0.0] + SQUARES * [1.0, -1.0]
    runs = [driven(model, true, way(turns), rng) for turns in shapes]
    tape = Reference(TAPE_M, PLACED_RAD, fixed=True, follows_base=True)
    return change, calibrate(nominal, runs, tape, MotionNoise())


def calibrated_in_full(robot: str, seed: int) -> tuple[NDArray[np.float64], Calibration]:
    """Return the same for the simulated robot, as `robotctl calibrate odometry` drives it."""
    path = find_file(robot)
    nominal = load_robot(path).drive
    model = OdometryModel(nominal)
    change = true_change(model, np.random.default_rng(seed))
    campaign = Campaign(path, _disturbed(nominal, model.drive(change)), seed)
    runs = list(campaign.drives(model, lambda _line: None))
    tape = Reference(TAPE_M, PLACED_RAD, fixed=True, follows_base=True)
    return change, calibrate(nominal, runs, tape, MotionNoise())


def _disturbed(nominal: Drive, true: Drive) -> tuple[str, ...]:
    """Return the settings that make the simulated robot the true one."""
    pairs = zip(true.wheel_radii_m, nominal.wheel_radii_m, strict=True)
    radii = [float(is_m / should_m - 1.0) for is_m, should_m in pairs]
    errors = [f"wheel_radius={radii}"]
    # Each key of the drive's own is an error of the simulator by the same name: relative, or [rad].
    for key in nominal.calibrated:
        if key.startswith("wheel_radius"):
            continue
        should, is_so = getattr(nominal, key), getattr(true, key)
        error = is_so - should if key.endswith("_rad") else is_so / should - 1.0
        errors.append(f"{key.removesuffix('_m')}={error}")
    return tuple(f"simulation.errors.{error}" for error in errors)


def held(change: NDArray[np.float64], found: Calibration) -> NDArray[np.bool_]:
    """Return which intervals hold the truth: three keys of the drive, then the two diameters."""
    hits = (np.abs(found.change - change) <= found.change_half_width).tolist()
    diameters = found.wheel_diameters()
    if diameters:
        true = found.model.drive(change)
        for interval, radius_m in zip(diameters, true.wheel_radii_m, strict=True):
            hits.append(interval.low <= 2.0 * radius_m <= interval.high)
    return np.array(hits)


def run(_rounds: int, _seconds: float) -> None:
    """Print how many of the seeds' intervals hold the truth, for each robot and key."""
    for robot in ROBOTS:
        nominal = load_robot(find_file(robot)).drive
        _count(f"{robot}, kinematics", [calibrated(nominal, seed) for seed in range(SEEDS)])
    for robot in ROBOTS:
        _count(f"{robot}, in full", [calibrated_in_full(robot, seed) for seed in range(FULL_SEEDS)])


def _count(title: str, results: list[tuple[NDArray[np.float64], Calibration]]) -> None:
    """Print one table."""
    model = results[0][1].model
    diameters = ("left diameter", "right diameter")
    names = [*model.keys, *(diameters if len(model.nominal.wheel_radii_m) == 2 else ())]
    counts = np.sum([held(*result) for result in results], axis=0).tolist()
    machine.note(f"\n{title}: seeds of {len(results)} whose 95 % interval holds the truth")
    for name, count in zip(names, counts, strict=True):
        machine.note(f"  {name:<22}{count}")
    for what, rows in (
        ("half width, median", [found.change_half_width for _, found in results]),
        ("error, greatest", [np.abs(found.change - change) for change, found in results]),
    ):
        middle = np.median(rows, axis=0) if "median" in what else np.max(rows, axis=0)
        machine.note(f"  {what:<22}{', '.join(f'{value:.5f}' for value in middle)}")
