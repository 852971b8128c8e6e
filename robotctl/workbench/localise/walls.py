"""EKF localisation of a recorded drive by the ranges of its sonars to walls."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np

from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.odometry.estimate import arc_between
from robotctl.logs.recorded_motion import (
    known_from_ns,
    reference_at,
    with_noise,
    with_noisy_motion,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.wall_map import WallMap
from robotctl.workbench.localise.options import (
    LocaliseError,
    LocaliseOptions,
    Progress,
    known_start,
)
from robotctl.workbench.localise.report import Run


def run_wall_ekf(
    recording: Recording,
    options: LocaliseOptions,
    walls: WallMap,
    rng: np.random.Generator,
    progress: Progress,
) -> Run:
    """Follow the filter through the odometry, from where the reference begins.

    Raises
    ------
    LocaliseError
        If there is no odometry, or no start is known.
    """
    start_rng, odometry_rng = rng.spawn(2)
    odometry = with_noisy_motion(recording, options.odometry_sigmas, odometry_rng).odometry
    if odometry is None:
        raise LocaliseError(f"{recording.name}: no odometry in it")
    begin_ns = int(odometry.stamps_ns[0])
    if options.start is None:
        begin_ns = max(begin_ns, known_from_ns(recording))
    known = odometry.stamps_ns >= begin_ns
    stamps_ns = odometry.stamps_ns[known].tolist()
    poses = [SE2(*row) for row in odometry.poses[known].tolist()]
    start = known_start(recording, options, stamps_ns[0], start_rng)
    config = EkfConfig()
    motion = with_noise(config.motion, options.odometry_sigmas)
    ekf = PoseEkf(replace(config, motion=motion), start)
    sonars = deque(each for each in recording.sonars if each.reading.stamp_ns > begin_ns)
    run = Run(has_heading=recording.reference_has_heading)
    steps = list(zip(stamps_ns[1:], pairwise(poses), strict=True))
    for done, (stamp_ns, (before, after)) in enumerate(steps, 1):
        began_ns = time.process_time_ns()
        used = 0
        while sonars and sonars[0].reading.stamp_ns <= stamp_ns:
            used += _hear(ekf, sonars.popleft().reading, recording, walls)
        if stamp_ns > ekf.stamp_ns:
            ekf.predict(stamp_ns, *arc_between(before.inverse() @ after))
        if used:
            spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
            run.update_ms += [spent_ms / used] * used
        run.add(ekf.estimate(), reference_at(recording, stamp_ns))
        progress(done, len(steps))
    return run


def _hear(ekf: PoseEkf, reading: SonarReading, recording: Recording, walls: WallMap) -> int:
    """Hand ranges to the filter; return how many."""
    for mount, range_m in zip(recording.sonar_mounts, reading.ranges_m, strict=True):
        ekf.update_sonar(reading.stamp_ns, mount, range_m, walls)
    return sum(map(math.isfinite, reading.ranges_m))
