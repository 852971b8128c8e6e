"""EKF localisation of a recorded drive by its sightings of known landmarks."""

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
from robotctl.app.recorded_motion import increments, noisy, reference_at, with_noise
from robotctl.estimation.ekf import PoseEkf
from robotctl.estimation.ekf_config import EkfConfig
from robotctl.estimation.odometry_estimate import arc_between
from robotctl.model.motion import arc
from robotctl.model.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.recording import Recording
from robotctl.model.se2 import SE2

_STEPS_TOLD = 1000


def run_ekf(
    recording: Recording, options: LocalizeOptions, rng: np.random.Generator, progress: Progress
) -> Run:
    """Follow the filter through the motion; estimates stand at the ends of the motion's steps.

    Raises
    ------
    LocalizeError
        If there are no sightings, no motion, or no start is known.
    """
    if not recording.sightings:
        raise LocalizeError(
            f"{options.log}: no sightings of landmarks in it, which --method ekf needs; a log "
            "with scans is for --method mcl"
        )
    stamps_ns, deltas = _motion(recording)
    start_rng, odometry_rng = rng.spawn(2)
    start = disturbed_start(recording, stamps_ns[0], start_rng)
    variances = np.array([START_SIGMA_M, START_SIGMA_M, START_SIGMA_RAD]) ** 2
    config = EkfConfig()
    ekf = PoseEkf(
        replace(config, motion=with_noise(config.motion, options.odometry_noise)),
        PoseEstimate(stamps_ns[0], start, np.diag(variances), LocalisationStatus.LOCALISED),
    )
    run = Run(has_heading=recording.reference_has_heading)
    sightings = [each for each in recording.sightings if each.stamp_ns >= stamps_ns[0]]
    seen = 0
    steps = list(
        zip(stamps_ns[1:], noisy(deltas, options.odometry_noise, odometry_rng), strict=True)
    )
    for done, (stamp_ns, delta) in enumerate(steps, 1):
        began_ns = time.process_time_ns()
        first = seen
        while seen < len(sightings) and sightings[seen].stamp_ns <= stamp_ns:
            sighting = sightings[seen]
            ekf.update_landmark(
                sighting.stamp_ns,
                recording.landmarks[sighting.landmark],
                sighting.range_m,
                sighting.bearing_rad,
            )
            seen += 1
        if stamp_ns > ekf.stamp_ns:
            ekf.predict(stamp_ns, *arc_between(delta))
        if seen > first:
            spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
            run.update_ms += [spent_ms / (seen - first)] * (seen - first)
        run.add(ekf.estimate(), reference_at(recording, stamp_ns))
        if done % _STEPS_TOLD == 0 or done == len(steps):
            progress(done, len(steps))
    return run


def _motion(recording: Recording) -> tuple[list[int], list[SE2]]:
    """Return times, and the motion from each to the next, by velocities or by odometry."""
    if len(recording.twists) > 1:
        stamps_ns = recording.twist_stamps_ns.tolist()
        steps_s = 1e-9 * np.diff(recording.twist_stamps_ns)
        ways = recording.twists[:-1] * steps_s[:, None]
        return stamps_ns, [arc(SE2(), distance, turn) for distance, turn in ways.tolist()]
    if recording.odometry is None or len(recording.odometry.poses) < 2:
        raise LocalizeError(f"{recording.name}: no motion in it: neither velocities nor odometry")
    poses = [SE2(*row) for row in recording.odometry.poses.tolist()]
    return recording.odometry.stamps_ns.tolist(), increments(poses)[1:]
