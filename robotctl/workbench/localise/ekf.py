"""EKF localisation of a recorded drive by its sightings of known landmarks."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.cylinders import CylinderConfig, cylinders
from robotctl.estimation.landmarks.localisation import CountedOdometry, localise_by_landmarks
from robotctl.estimation.landmarks.smoothing import LandmarkSmoother, smoothed
from robotctl.logs.recorded_motion import (
    known_from_ns,
    reference_at,
    with_noise,
    with_noisy_motion,
)
from robotctl.model.recording import UNKNOWN_LANDMARK, Recording, Sighting
from robotctl.workbench.localise.options import (
    LocaliseError,
    LocaliseOptions,
    Progress,
    known_start,
)
from robotctl.workbench.localise.report import Run

_TOLD = 1000
_ARM_SIGMA_M = 0.01
_BEARING_SIGMA_RAD = 0.01
"""Uncertainty of a lidar's mounting: better than a camera's."""


def run_ekf(
    recording: Recording, options: LocaliseOptions, rng: np.random.Generator, progress: Progress
) -> Run:
    """Follow the filter through the drive, from where motion and reference begin, and back.

    Raises
    ------
    LocaliseError
        If there are no sightings, no motion, or no start is known.
    """
    config = LandmarkConfig()
    if recording.landmarks and not recording.sightings:
        recording = replace(recording, sightings=_cylinders(recording))
        config = replace(config, arm_sigma_m=_ARM_SIGMA_M, bearing_sigma_rad=_BEARING_SIGMA_RAD)
    if not recording.sightings:
        raise LocaliseError(
            f"{options.log}: no sightings of landmarks in it, and no sonars with a map of walls, "
            f"which --method ekf needs; for a log with scans use --method mcl{recording.why()}"
        )
    start_rng, odometry_rng = rng.spawn(2)
    recording = with_noisy_motion(recording, options.odometry_sigmas, odometry_rng)
    config = replace(config, motion=with_noise(config.motion, options.odometry_sigmas))
    try:
        begin_ns = CountedOdometry(recording).begin_ns
        if options.start is None:
            begin_ns = max(begin_ns, known_from_ns(recording))
    except ValueError as error:
        raise LocaliseError(str(error)) from error
    start = known_start(recording, options, begin_ns, start_rng)
    run = Run(has_heading=recording.reference_has_heading)
    smoother = LandmarkSmoother(config)
    began_ns = time.process_time_ns()
    for step in localise_by_landmarks(recording, config, start):
        spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
        if step.innovations:
            run.update_ms += [spent_ms / len(step.innovations)] * len(step.innovations)
        run.online.append(step.estimate)
        smoother.add(step)
        progress(round(_TOLD * step.share), _TOLD)
        began_ns = time.process_time_ns()
    for estimate in smoothed(recording, config, start, smoother):
        run.add(estimate, reference_at(recording, estimate.stamp_ns))
    return run


def _cylinders(recording: Recording) -> tuple[Sighting, ...]:
    """Return the cylinders in the scans as sightings of unknown landmarks."""
    config = CylinderConfig()
    return tuple(
        Sighting(entry.scan.stamp_ns, UNKNOWN_LANDMARK, range_m, bearing_rad)
        for entry in recording.scans
        for range_m, bearing_rad in cylinders(entry.scan, config).tolist()
    )
