"""Localisation by landmarks on the MRCLAM logs of ROBOTCTL_DATA.

Beside simpler estimators; from starts that are off; and on the same logs made worse on purpose, to
see what the settings bear that no log here shows.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.estimation.kalman.consistency import pose_nees, share_inside
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.localisation import CountedOdometry, localise_by_landmarks
from robotctl.estimation.landmarks.smoothing import LandmarkSmoother, smoothed
from robotctl.logs.formats.mrclam_log import ROBOTS, read_mrclam
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.recording import Recording, Sighting
from robotctl.workbench.localise.report import is_wrong

GOAL_M, GOAL_INSIDE, GOAL_WRONG = 0.15, 0.90, 0.005
START_SIGMA = np.array([0.25, 0.25, 0.1])
DISTURBED = 3
STEP_NS = 100_000_000

Estimator = Callable[[Recording, PoseEstimate], Iterator[PoseEstimate]]


def self_calibrating(recording: Recording, start: PoseEstimate) -> Iterator[PoseEstimate]:
    """The filter of `robotctl localise --method ekf`."""
    for step in localise_by_landmarks(recording, LandmarkConfig(), start):
        yield step.estimate


def by_all(recording: Recording, start: PoseEstimate) -> Iterator[PoseEstimate]:
    """The same with all that was seen: the trajectory of that command."""
    smoother = LandmarkSmoother(LandmarkConfig())
    for step in localise_by_landmarks(recording, LandmarkConfig(), start):
        smoother.add(step)
    yield from smoothed(recording, LandmarkConfig(), start, smoother)


def textbook(recording: Recording, start: PoseEstimate) -> Iterator[PoseEstimate]:
    """Pose and velocities alone, with the noises that the data set's readers report."""
    config = EkfConfig(
        motion=LandmarkConfig().motion,
        landmark_range_sigma_m=0.1,
        landmark_range_sigma_m_per_m=0.0,
        landmark_bearing_sigma_rad=0.02,
    )
    odometry, ekf = CountedOdometry(recording), PoseEkf(config, start)
    sightings = [each for each in recording.sightings if each.stamp_ns >= start.stamp_ns]
    before, seen = odometry.at(start.stamp_ns, 0.0), 0
    for stamp_ns in range(start.stamp_ns + STEP_NS, odometry.end_ns, STEP_NS):
        while seen < len(sightings) and sightings[seen].stamp_ns <= stamp_ns:
            each = sightings[seen]
            place = recording.landmarks[each.landmark]
            ekf.update_landmark(each.stamp_ns, place, each.range_m, each.bearing_rad)
            seen += 1
        now = odometry.at(stamp_ns, 0.0)
        ekf.predict(stamp_ns, now.distance_m - before.distance_m, now.turn_rad - before.turn_rad)
        before = now
        yield ekf.estimate()


def dead_reckoning(recording: Recording, start: PoseEstimate) -> Iterator[PoseEstimate]:
    """The same without sightings."""
    blind = Recording(
        recording.name, twist_stamps_ns=recording.twist_stamps_ns, twists=recording.twists
    )
    return textbook(blind, start)


OWN: dict[str, Estimator] = {"LandmarkEkf": self_calibrating, "smoothed": by_all}
OTHERS: dict[str, Estimator] = {"PoseEkf": textbook, "dead reckoning": dead_reckoning}


def each_sighting(
    change: Callable[[Sighting, np.random.Generator], Sighting], share: float = 1.0
) -> Callable[[Recording], Recording]:
    """Change a share of the sightings, drawn by a fixed seed."""

    def worse(recording: Recording) -> Recording:
        rng = np.random.default_rng(0)
        seen = [change(s, rng) if rng.random() < share else s for s in recording.sightings]
        return replace(recording, sightings=tuple(seen))

    return worse


def rough(recording: Recording) -> Recording:
    """Add 0.15 rad/s and 20 % of the speed, each for 30 velocities alike: three times the noise."""
    rng = np.random.default_rng(3)
    twists = recording.twists.copy()
    blocks = len(twists) // 30 + 1
    turn, speed = np.repeat(rng.standard_normal((2, blocks)), 30, axis=1)[:, : len(twists)]
    twists[:, 1] += 0.15 * turn * (twists[:, 0] > 0.0)
    twists[:, 0] *= 1.0 + 0.2 * speed
    return replace(recording, twists=twists)


def blind(
    first_s: float, lasting_s: float, period_s: float = math.inf
) -> Callable[[Recording], Recording]:
    """Leave out the sightings of a time [s], again after each period: a barrier in the way."""

    def worse(recording: Recording) -> Recording:
        begin_ns = int(recording.twist_stamps_ns[0])
        seen = tuple(
            each
            for each in recording.sightings
            if (1e-9 * (each.stamp_ns - begin_ns) - first_s) % period_s >= lasting_s
        )
        return replace(recording, sightings=seen)

    return worse


def half(recording: Recording) -> Recording:
    """Leave out the landmarks with odd numbers."""
    seen = tuple(each for each in recording.sightings if each.landmark % 2 == 0)
    return replace(recording, sightings=seen)


def wild(s: Sighting, rng: np.random.Generator) -> Sighting:
    return replace(s, range_m=rng.uniform(0.5, 8.0), bearing_rad=rng.uniform(-0.5, 0.5))


def misread(s: Sighting, rng: np.random.Generator) -> Sighting:
    return replace(s, landmark=int(rng.integers(6, 21)))


def noisier(s: Sighting, rng: np.random.Generator) -> Sighting:
    range_m = max(0.1, s.range_m + 0.1 * rng.standard_normal())
    return replace(s, range_m=range_m, bearing_rad=s.bearing_rad + 0.02 * rng.standard_normal())


def off_camera(s: Sighting, rng: np.random.Generator) -> Sighting:
    return replace(s, range_m=1.08 * s.range_m + 0.1, bearing_rad=s.bearing_rad + 0.05)


def as_distance(s: Sighting, rng: np.random.Generator) -> Sighting:
    return replace(s, range_m=s.range_m / math.cos(s.bearing_rad))


WORSE: dict[str, Callable[[Recording], Recording]] = {
    "10 % wild sightings": each_sighting(wild, 0.1),
    "10 % misread names": each_sighting(misread, 0.1),
    "0.1 m, 0.02 rad more noise": each_sighting(noisier),
    "one sighting of 16": lambda log: replace(log, sightings=log.sightings[::16]),
    "ranges as distances": each_sighting(as_distance),
    "camera turned, ranges 8 % + 0.1 m long": each_sighting(off_camera),
    "odometry scaled by 1.2 and 0.85": lambda log: replace(log, twists=log.twists * [1.2, 0.85]),
    "odometry three times as rough": rough,
    "blind for the first 60 s": blind(0.0, 60.0),
    "blind for the first 120 s": blind(0.0, 120.0),
    "blind for 60 s of 150 s": blind(40.0, 60.0, 150.0),
    "blind for 90 s of 150 s": blind(40.0, 90.0, 150.0),
    "every other landmark": half,
}


def recordings() -> Iterator[Recording]:
    """Each robot of each MRCLAM folder under ROBOTCTL_DATA that has a reference."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", "../shared/data"), "mrclam")
    for data_set in sorted(folder.glob("MRCLAM_Dataset*")):
        for robot in range(1, ROBOTS + 1):
            if any(data_set.glob(f"Robot{robot}_Groundtruth.dat*")):
                yield read_mrclam(data_set, robot)


def start_of(recording: Recording, seed: int | None) -> PoseEstimate:
    """The reference's pose where motion begins; with a seed, as far off as START_SIGMA says."""
    reference = recording.reference
    assert reference is not None
    begin_ns = max(int(recording.twist_stamps_ns[0]), int(reference.stamps_ns[0]))
    pose = reference.at(begin_ns)
    assert pose is not None
    sigma = START_SIGMA if seed is not None else np.full(3, 0.05)
    off = (
        sigma * np.random.default_rng(seed).standard_normal(3) if seed is not None else 0.0 * sigma
    )
    x, y, theta = (np.array([pose.x_m, pose.y_m, pose.theta_rad]) + off).tolist()
    return PoseEstimate(
        begin_ns, type(pose)(x, y, theta), np.diag(sigma**2), LocalisationStatus.LOCALISED
    )


def figures(recording: Recording, estimates: Iterator[PoseEstimate]) -> tuple[float, ...]:
    """Return rmse [m], greatest error [m], heading rmse [rad], NEES inside, shares lost, wrong."""
    errors, headings, nees, lost, wrong = [], [], [], [], []
    for estimate in estimates:
        truth = recording.reference.at(estimate.stamp_ns)
        if truth is None:
            continue
        pose = estimate.pose
        errors.append(math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m))
        headings.append(math.remainder(pose.theta_rad - truth.theta_rad, math.tau))
        nees.append(pose_nees(estimate, truth))
        lost.append(estimate.status is LocalisationStatus.LOST)
        wrong.append(is_wrong(estimate, truth, has_heading=True))
    return (
        float(np.sqrt(np.mean(np.square(errors)))),
        max(errors),
        float(np.sqrt(np.mean(np.square(headings)))),
        share_inside(np.array(nees), 3),
        float(np.mean(lost)),
        float(np.mean(wrong)),
    )


def row_of(
    recording: Recording, name: str, estimator: Estimator, start: PoseEstimate, what: str
) -> tuple[tuple[str, ...], bool]:
    """Return a row of the tables, and whether it meets the goal."""
    rmse, most, heading, inside, lost, wrong = figures(recording, estimator(recording, start))
    met = rmse <= GOAL_M and inside >= GOAL_INSIDE and lost == 0.0 and wrong <= GOAL_WRONG
    row = (
        recording.name,
        name,
        what,
        f"{rmse:.3f}",
        f"{most:.2f}",
        f"{heading:.3f}",
        f"{inside:.3f}",
        f"{lost:.3f}",
        f"{wrong:.3f}",
    )
    return row, met


def run(rounds: int, seconds: float) -> None:
    """Follow each robot."""
    own, others, worse, all_met = [], [], [], True
    for recording in recordings():
        for seed in (None, *range(DISTURBED)):
            what = "at the reference" if seed is None else f"off, seed {seed}"
            for name, estimator in OWN.items():
                row, met = row_of(recording, name, estimator, start_of(recording, seed), what)
                own.append(row)
                all_met &= met
        start = start_of(recording, None)
        for name, estimator in OTHERS.items():
            others.append(row_of(recording, name, estimator, start, "at the reference")[0])
        for what, change in WORSE.items():
            changed = change(recording)
            for name, estimator in OWN.items():
                worse.append(row_of(changed, name, estimator, start, what)[0])
    heads = (
        "log", "estimator", "start", "rmse m", "max m", "heading rad", "NEES in 95 %", "lost",
        "wrong",
    )  # fmt: skip
    machine.table("Localisation by landmarks", heads, own + others)
    machine.table("The same logs made worse", (*heads[:2], "what", *heads[3:]), worse)
    met = "no recordings in ROBOTCTL_DATA" if not own else "met" if all_met else "not met"
    machine.note(
        f"goal: rmse <= {GOAL_M:g} m, NEES inside >= {GOAL_INSIDE:g}, never lost, "
        f"confidently wrong <= {GOAL_WRONG:g}: {met}"
    )
