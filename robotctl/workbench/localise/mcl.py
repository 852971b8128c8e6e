"""Monte Carlo localisation of a recorded drive by its scans and sonars."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Final

import numpy as np

from robotctl.app.localisation.map_sensors import MapSensors
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_area_m2, free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.mcl.map_symmetry import symmetries
from robotctl.estimation.mcl.search_size import search_size, too_large
from robotctl.estimation.mcl.sliced import Work
from robotctl.estimation.ranging.echo_share import EchoShare
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.sensor_names import LIDAR, SONAR
from robotctl.estimation.sensors.lidar import lidar_source
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.logs.recorded_motion import increments, known_from_ns, noisy, reference_at, with_noise
from robotctl.maps.localisation_map import off_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.world_map import WorldMap
from robotctl.workbench.localise.mapping import choose_scans
from robotctl.workbench.localise.options import (
    START_SIGMA_M,
    START_SIGMA_RAD,
    LocaliseError,
    LocaliseOptions,
    Progress,
    known_start,
)
from robotctl.workbench.localise.report import Run

_POSES_AT_ONCE: Final = 75_000
"""Poses weighed at one moment; the rest of a search waits for the next, as on a robot."""
_ALL: Final = 1 << 62
"""At the last moment nothing is left over."""
FITS_NOWHERE: Final = (
    "what was seen matches no place on this map; is it the right map, and up to date?"
)


@dataclass(frozen=True, slots=True)
class _Moment:
    """Something that was measured."""

    stamp_ns: int
    sensor: str
    odometry: SE2
    reference: SE2 | None
    measurement: Callable[[MapSensors], LogLikelihood]
    scan: RangeScan | None = None


def run_mcl(
    recording: Recording,
    options: LocaliseOptions,
    world_map: WorldMap,
    rng: np.random.Generator,
    progress: Progress,
) -> Run:
    """Follow the particles through all that was measured.

    As in the navigation process, each sensor weights them once per stretch, and what is measured
    while a search is under way is left out. The first measurements are tried on a throw-away
    localiser before: that compiles the kernels, so that the times of the updates are theirs alone.

    Raises
    ------
    LocaliseError
        If nothing was measured, no start is known, or the map is empty.
    """
    moments = _moments(recording, options)
    start_rng, odometry_rng, filter_rng = rng.spawn(3)
    localiser, sensors = _made(recording, options, world_map, moments, filter_rng)
    if not options.search:
        known_ns = known_from_ns(recording) if options.start is None else 0
        moments = [each for each in moments if each.stamp_ns >= known_ns] or moments
        first = moments[0]
        start = known_start(recording, options, first.stamp_ns, start_rng, first.reference)
        localiser.start_at(start.pose, START_SIGMA_M, START_SIGMA_RAD)
    echo_share, work = EchoShare(world_map.grid), Work()
    at_once = max(_POSES_AT_ONCE, 2 * options.max_particles)
    deltas = increments([moment.odometry for moment in moments])
    run = Run(has_heading=recording.reference_has_heading, starts_known=not options.search)
    if not options.search and (warning := off_map(world_map, start.pose)):
        run.notes.append(warning)
    if options.search and options.particles is None:
        run.notes += filter(None, [too_large(free_area_m2(world_map.grid))])
    for done, (moment, delta) in enumerate(
        zip(moments, noisy(deltas, options.odometry_sigmas, odometry_rng), strict=True), 1
    ):
        began_ns = time.process_time_ns()
        localiser.move(delta)
        poses = at_once if done < len(moments) else _ALL
        is_busy, left = work.is_under_way, work.go_on(poses)
        if not work.is_under_way and left > 0 and localiser.due(moment.sensor):
            measuring = localiser.measuring(moment.measurement(sensors), moment.sensor)
            is_busy, _ = True, work.begin(measuring, left)
        if is_busy:
            run.update_ms.append(1e-6 * (time.process_time_ns() - began_ns))
            run.particles.append(len(localiser.poses))
        estimate, scan = localiser.estimate(moment.stamp_ns), moment.scan
        share = None if scan is None else echo_share(scan, estimate.pose)
        run.add(estimate, moment.reference, share)
        progress(done, len(moments))
    if localiser.fits_nowhere:
        run.notes.append(f"{options.map}: {FITS_NOWHERE}")
    return run


def _moments(recording: Recording, options: LocaliseOptions) -> list[_Moment]:
    """Return all that was measured in the order of its times."""
    moments = []
    for entry in choose_scans(recording, options.scans) if recording.scans else ():
        stamp_ns, scan = entry.scan.stamp_ns, entry.scan
        reference = entry.reference or reference_at(recording, stamp_ns)
        measurement = partial(MapSensors.measurement, sensor=LIDAR, measured=scan)
        source = lidar_source(scan)
        moments.append(_Moment(stamp_ns, source, entry.odometry, reference, measurement, scan))
    for heard in recording.sonars if recording.sonar_mounts else ():
        stamp_ns, reading = heard.reading.stamp_ns, heard.reading
        reference = reference_at(recording, stamp_ns)
        sonar = partial(MapSensors.measurement, sensor=SONAR, measured=reading)
        source = f"{SONAR} {reading.first}"
        moments.append(_Moment(stamp_ns, source, heard.odometry, reference, sonar))
    if not moments:
        raise LocaliseError(
            f"{options.log}: no scans of use in it, which --method mcl needs; for a log with "
            f"sightings of landmarks use --method ekf{recording.why()}"
        )
    return sorted(moments, key=attrgetter("stamp_ns"))


def _made(
    recording: Recording,
    options: LocaliseOptions,
    world_map: WorldMap,
    moments: Sequence[_Moment],
    rng: np.random.Generator,
) -> tuple[MonteCarloLocaliser, MapSensors]:
    """Return a localiser and its measurement model, with compiled kernels."""
    config = MclConfig.tuned((options.sensors or LocalisationConfig()).mcl)
    most, noise = options.max_particles, config.motion.noise
    if options.odometry is not None:
        noise = noise.at_least(options.odometry)
    config = replace(
        config,
        motion=replace(config.motion, noise=with_noise(noise, options.odometry_sigmas)),
        max_particles=most,
        min_particles=min(most, config.min_particles),
    )
    try:
        settings = options.sensors or LocalisationConfig()
        if options.beams is not None:
            settings = replace(settings, lidar=replace(settings.lidar, beams=options.beams))
        sensors = MapSensors(world_map, SensedRobot(recording.sonar_mounts, settings))
        free = free_poses(world_map.grid)
        fewer = replace(config, max_particles=config.min_particles)
        if options.particles is None:
            size = search_size(free_area_m2(world_map.grid))
            config = replace(config, search_poses=max(size, most))
        tried = MonteCarloLocaliser(fewer, free, np.random.default_rng(0))
        for sensor in {moment.sensor for moment in moments}:
            first = next(moment for moment in moments if moment.sensor == sensor)
            tried.measure(first.measurement(sensors))
        return MonteCarloLocaliser(config, free, rng, symmetries(world_map.grid)), sensors
    except ValueError as error:
        raise LocaliseError(f"{options.map}: {error}") from error
