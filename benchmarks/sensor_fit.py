"""Characterisation of sensors: are the true values inside of their 95 % intervals, over many seeds?

The true sonar is that of firmware_sim, which shares no line with what is fitted: each seed draws
sensor parameters, stands the ring at poses all over a world and fires it. Then the same for ranges
drawn part by part from a mixture, which also has shares of short readings with a rate of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import ndimage

from benchmarks import machine
from firmware_sim.config.config import RobotConfig
from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.world import World, load_world
from robotctl.config.robot_file import find_file
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.ranging.fit.expected_ranges import EchoExpectations, Sightlines
from robotctl.estimation.ranging.fit.range_fit import Fitted, fit_ranges
from robotctl.estimation.ranging.fit.sensor_fit import Readings, fit_sensor, reach_m
from robotctl.estimation.ranging.range_mixture import BeamMixture
from robotctl.model.wall_map import WallMap

SEEDS = 100
POSES = 1500
_CLEAR_M = 0.3
_REACH_M = 8.0


def run(_rounds: int, _seconds: float) -> None:
    """Measure all."""
    for world in ("flat", "office"):
        _table(
            f"Simulated sonar ring in `{world}`: true values inside of their 95 % intervals",
            lambda seed, world=world: ring_seed(world, seed, POSES),
        )
    _table(
        "Ranges drawn from a mixture: true values inside of their 95 % intervals",
        lambda seed: mixture_seed(seed, 6000),
    )


def _table(title: str, work: Callable[[int], dict[str, tuple[float, Fitted]]]) -> None:
    inside: dict[str, list[bool]] = {}
    widths: dict[str, list[float]] = {}
    began = time.process_time()
    for seed in range(SEEDS):
        for name, (truth, found) in work(seed).items():
            inside.setdefault(name, []).append(found.low <= truth <= found.high)
            widths.setdefault(name, []).append((found.high - found.low) / abs(truth))
    spent = (time.process_time() - began) / SEEDS
    rows = [
        (name, f"{sum(each)} of {len(each)}", f"{100 * np.median(widths[name]):.1f} %")
        for name, each in inside.items()
    ]
    machine.table(title, ("parameter", "inside", "median width, share of the truth"), rows)
    machine.note(f"{spent:.2f} s of processor time a seed")


def ring(world: World, seed: int) -> tuple[RobotConfig, SonarRing]:
    """Return a robot whose sonars have values of their own, and its ring without cross-talk."""
    config = load_simulated_robot(find_file("diff_drive"))
    rng = np.random.default_rng([seed, 1])
    sonar = replace(
        config.simulation.sonar,
        sigma_m=float(rng.uniform(0.002, 0.01)),
        sigma_per_m=float(rng.uniform(0.002, 0.01)),
        max_incidence_deg=float(rng.uniform(25.0, 50.0)),
        max_range_m=float(rng.uniform(3.0, 4.5)),
        outlier_probability=float(rng.uniform(0.003, 0.05)),
        dropout_probability=float(rng.uniform(0.003, 0.05)),
        crosstalk_probability=0.0,
    )
    config = replace(config, simulation=replace(config.simulation, sonar=sonar))
    return config, SonarRing(config, world, rng)


def ring_seed(world_name: str, seed: int, n: int) -> dict[str, tuple[float, Fitted]]:
    """Return truth and finding for each value of a sonar ring."""
    world = load_world(find_file(world_name, "worlds"))
    walls = WallMap(np.ascontiguousarray(world.segments))
    config, sonars = ring(world, seed)
    rng = np.random.default_rng([seed, 2])
    grid = grid_of_walls(walls)
    clear = ndimage.distance_transform_edt(grid.free()) * grid.resolution_m > _CLEAR_M
    cells = np.argwhere(clear)[rng.integers(np.count_nonzero(clear), size=n)]
    poses = np.column_stack([grid.centre_of(cells), rng.uniform(-math.pi, math.pi, n)])
    count = len(config.sonar)
    ranges = np.array(
        [[r for group in range(sonars.groups) for r in sonars.fire(group, *at)] for at in poses]
    )[:, :count]
    readings = Readings(
        Sightlines(np.repeat(poses, count, axis=0), np.tile(np.arange(count), n)), ranges.ravel()
    )
    mounts = np.array([(m.x_m, m.y_m, m.heading_rad) for m in config.sonar])
    truth = config.simulation.sonar
    expectations = EchoExpectations(walls, mounts, math.radians(truth.beam_deg), reach_m(readings))
    found = fit_sensor(expectations, readings)
    values = found.ranges.values
    heard = 1.0 - truth.dropout_probability
    limit = found.incidence.limit
    degrees = [math.degrees(each) for each in (limit.value, limit.low, limit.high)]
    return {
        "sigma_m": (math.hypot(truth.sigma_m, 0.001 / math.sqrt(12.0)), values["sigma_m"]),
        "sigma_per_m": (truth.sigma_per_m, values["sigma_per_m"]),
        "outliers": (heard * truth.outlier_probability, values["garbage"]),
        "short": (0.5 * heard * truth.outlier_probability, values["short"]),
        "random": (0.5 * heard * truth.outlier_probability, values["random"]),
        "none": (truth.dropout_probability, values["none"]),
        "max_incidence_deg": (truth.max_incidence_deg, Fitted(*degrees)),
        "max_range_m": (truth.max_range_m, found.greatest_m),
    }


def mixture_seed(seed: int, n: int) -> dict[str, tuple[float, Fitted]]:
    """Return truth and finding for each value of a mixture."""
    rng = np.random.default_rng(seed)
    short, none, other = rng.uniform(0.005, 0.08, 3).tolist()
    mixture = BeamMixture(
        1.0 - short - none - other,
        short,
        none,
        other,
        float(rng.uniform(0.002, 0.05)),
        float(rng.uniform(-0.01, 0.01)),
        float(rng.uniform(0.3, 2.0)),
        float(rng.uniform(0.002, 0.02)),
    )
    expected = rng.uniform(0.3, 0.7 * _REACH_M, n)
    expected[: n // 10] = np.inf
    fit = fit_ranges(expected, drawn(mixture, expected, _REACH_M, rng), _REACH_M)
    truth = {name: getattr(mixture, name) for name in BeamMixture.__slots__}
    truth["robust_k"] = mixture.robust_k(fit.typical_m, _REACH_M)
    return {name: (value, fit.values[name]) for name, value in truth.items()}


def drawn(
    mixture: BeamMixture, expected: np.ndarray, max_range_m: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw a range for each expected one, part by part."""
    n = len(expected)
    m = np.minimum(expected, max_range_m)
    part = rng.choice(4, n, p=[mixture.hit, mixture.short, mixture.none, mixture.random])
    hit = expected + mixture.offset_m + mixture.sigma_at(m) * rng.standard_normal(n)
    cut = -np.expm1(-mixture.short_per_m * m)
    short = -np.log1p(-rng.random(n) * cut) / mixture.short_per_m
    z = np.choose(part, [hit, short, np.full(n, np.inf), max_range_m * rng.random(n)])
    return np.where(z < max_range_m, np.maximum(z, 0.0), np.inf)
