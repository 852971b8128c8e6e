"""Monte Carlo localisation of a recorded drive by its scans."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from robotctl.app.localize_options import (
    START_SIGMA_M,
    START_SIGMA_RAD,
    LocalizeError,
    LocalizeOptions,
    Progress,
    disturbed_start,
)
from robotctl.app.localize_report import Run
from robotctl.app.mapping import choose_scans
from robotctl.app.recorded_motion import increments, noisy, reference_at, with_noise
from robotctl.estimation.free_space import free_poses
from robotctl.estimation.likelihood_field import LikelihoodField, LikelihoodFieldConfig
from robotctl.estimation.mcl import MonteCarloLocaliser
from robotctl.estimation.mcl_config import MclConfig
from robotctl.model.grid_map import GridMap
from robotctl.model.range_scan import RangeScan
from robotctl.model.recording import Recording


def run_mcl(
    recording: Recording,
    options: LocalizeOptions,
    grid: GridMap,
    rng: np.random.Generator,
    progress: Progress,
) -> Run:
    """Follow the particles through the scans.

    The first update of a throw-away localiser loads or compiles the kernels, so that the times of
    the others are theirs alone.

    Raises
    ------
    LocalizeError
        If there are no scans, no start is known, or the map is empty.
    """
    if not recording.scans:
        raise LocalizeError(
            f"{options.log}: no scans in it, which --method mcl weighs; a log with sightings of "
            "landmarks is for --method ekf"
        )
    scans = choose_scans(recording, options.scans)
    start_rng, odometry_rng, filter_rng = rng.spawn(3)
    field, localiser = _made(options, grid, scans[0].scan, filter_rng)
    if not options.search:
        start = disturbed_start(recording, scans[0].scan.stamp_ns, start_rng)
        localiser.start_at(start, START_SIGMA_M, START_SIGMA_RAD)
    deltas = increments([entry.odometry for entry in scans])
    run = Run(has_heading=recording.reference_has_heading, starts_known=not options.search)
    for done, (entry, delta) in enumerate(
        zip(scans, noisy(deltas, options.odometry_noise, odometry_rng), strict=True), 1
    ):
        began_ns = time.process_time_ns()
        localiser.move(delta)
        if localiser.due:
            localiser.measure(field.measurement(entry.scan))
            run.update_ms.append(1e-6 * (time.process_time_ns() - began_ns))
            run.particles.append(len(localiser.poses))
        stamp_ns = entry.scan.stamp_ns
        run.add(localiser.estimate(stamp_ns), entry.reference or reference_at(recording, stamp_ns))
        progress(done, len(scans))
    return run


def _made(
    options: LocalizeOptions, grid: GridMap, scan: RangeScan, rng: np.random.Generator
) -> tuple[LikelihoodField, MonteCarloLocaliser]:
    """Return sensor model and localiser on a map, with compiled kernels."""
    most = options.max_particles
    config = MclConfig()
    motion = replace(config.motion, noise=with_noise(config.motion.noise, options.odometry_noise))
    config = replace(
        config,
        motion=motion,
        max_particles=most,
        min_particles=min(most, config.min_particles),
    )
    try:
        field = LikelihoodField(grid, LikelihoodFieldConfig(beams=options.beams))
        free = free_poses(grid)
        first = MonteCarloLocaliser(
            replace(config, max_particles=config.min_particles), free, np.random.default_rng(0)
        )
        first.measure(field.measurement(scan))
        return field, MonteCarloLocaliser(config, free, rng)
    except ValueError as error:
        raise LocalizeError(f"{options.map}: {error}") from error
