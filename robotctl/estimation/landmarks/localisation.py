"""Localisation of a recorded drive by its sightings of known landmarks.

    for step in localise_by_landmarks(recording, LandmarkConfig(), start):
        step.estimate, step.innovations, step.share

gives the estimate at the end of each step of the prediction, `step_s` apart or less, and at each
time at which landmarks were seen, with what was seen until then and no more. The work is done
between steps, so the caller can measure the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.robust_kalman import Innovation
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.ekf import LandmarkEkf
from robotctl.estimation.landmarks.models import OdometryReading, S, sighting
from robotctl.estimation.landmarks.prediction import Prediction
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.recording import UNKNOWN_LANDMARK, Recording, Sighting

_VELOCITY_SPAN_S = 0.1
"""Over which velocities are averaged."""
_SAME_M = 0.3
"""A sighting without a name that is further from every landmark is of none [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkStep:
    """The estimate at one time.

    Parameters
    ----------
    estimate
        Of the pose.
    innovations
        Of the sightings of this time.
    made
        Prediction that led to it, before the sightings of this time.
    share
        How much of the recording is done, 0 to 1.
    ekf
        The filter, for its calibration.
    """

    estimate: PoseEstimate
    innovations: tuple[Innovation, ...]
    made: Prediction
    share: float
    ekf: LandmarkEkf


class CountedOdometry:
    """The odometry of a recording at any time.

    Parameters
    ----------
    recording
        With velocities, each of which holds until the next; or with odometry.

    Raises
    ------
    ValueError
        If it has neither.
    """

    def __init__(self, recording: Recording) -> None:
        if len(recording.twists) > 1:
            times_s = 1e-9 * (recording.twist_stamps_ns - recording.twist_stamps_ns[0])
            steps = recording.twists[:-1] * np.diff(times_s)[:, None]
            self.begin_ns = int(recording.twist_stamps_ns[0])
            self.end_ns = int(recording.twist_stamps_ns[-1])
        elif recording.odometry is not None and len(recording.odometry.poses) > 1:
            stamps_ns, poses = recording.odometry.stamps_ns, recording.odometry.poses
            times_s = 1e-9 * (stamps_ns - stamps_ns[0])
            steps = _arcs(poses)
            self.begin_ns, self.end_ns = int(stamps_ns[0]), int(stamps_ns[-1])
        else:
            raise ValueError(f"{recording.name}: no motion in it: neither velocities nor odometry")
        self._times_s = times_s
        self._counted = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def at(self, stamp_ns: int, delay_s: float) -> OdometryReading:
        """Return what had been counted some time before a time; at rest outside of the log."""
        t = 1e-9 * (stamp_ns - self.begin_ns) - delay_s
        half = 0.5 * _VELOCITY_SPAN_S
        times = np.array([t - half, t, t + half])
        distance = np.interp(times, self._times_s, self._counted[:, 0])
        turn = np.interp(times, self._times_s, self._counted[:, 1])
        return OdometryReading(
            float(distance[1]),
            float(turn[1]),
            float(distance[2] - distance[0]) / _VELOCITY_SPAN_S,
            float(turn[2] - turn[0]) / _VELOCITY_SPAN_S,
        )


def localise_by_landmarks(
    recording: Recording,
    config: LandmarkConfig,
    start: PoseEstimate,
    about: NDArray[np.float64] | None = None,
) -> Iterator[LandmarkStep]:
    """Follow a recorded drive from a start; see above.

    Parameters
    ----------
    recording, config, start
        The drive, priors, and the pose where it begins.
    about
        States about which the steps are linearised, (steps, n); None: about the estimates.

    Raises
    ------
    ValueError
        If the recording has no motion.
    """
    odometry = CountedOdometry(recording)
    begin_ns, end_ns = start.stamp_ns, odometry.end_ns
    ekf = LandmarkEkf(config, start)
    seen: dict[int, list[Sighting]] = {}
    for each in recording.sightings:
        if begin_ns <= each.stamp_ns <= end_ns:
            seen.setdefault(each.stamp_ns, []).append(each)
    grid = np.arange(begin_ns, end_ns, round(1e9 * config.step_s), dtype=np.int64)
    stamps_ns = np.union1d(grid, np.array([*seen, end_ns], dtype=np.int64)).tolist()
    for number, (previous_ns, stamp_ns) in enumerate(pairwise([begin_ns, *stamps_ns])):
        x = ekf.x if about is None else about[max(number - 1, 0)]
        delay_s = float(x[S.DELAY])
        begin, end = odometry.at(previous_ns, delay_s), odometry.at(stamp_ns, delay_s)
        made = ekf.predict(stamp_ns, begin, end, x)
        found = []
        for each in seen.get(stamp_ns, ()):
            x = ekf.x if about is None else about[number]
            landmark = _landmark_of(each, recording.landmarks, x)
            if landmark is not None:
                found.append(ekf.update(landmark, each.range_m, each.bearing_rad, x))
        share = (stamp_ns - begin_ns) / max(1, end_ns - begin_ns)
        yield LandmarkStep(ekf.estimate(), tuple(found), made, share, ekf)


def _landmark_of(
    each: Sighting, landmarks: dict[int, tuple[float, float]], x: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Return where the landmark is that was seen [m].

    A sighting without a name is of the landmark that should be seen nearest to it; None if that is
    not within `_SAME_M`. Good while the pose is known to about half of the landmarks' distances.
    """
    if each.landmark != UNKNOWN_LANDMARK:
        return landmarks[each.landmark]

    def apart_m(place: tuple[float, float]) -> float:
        expected, _, _ = sighting(x, place)
        turned = math.remainder(each.bearing_rad - float(expected[1]), math.tau)
        return math.hypot(each.range_m - float(expected[0]), each.range_m * turned)

    nearest = min(landmarks.values(), key=apart_m)
    return nearest if apart_m(nearest) <= _SAME_M else None


def _arcs(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return length [m] and turn [rad] of the arc from each pose to the next, (n - 1, 2)."""
    step = np.diff(poses[:, :2], axis=0)
    turn = np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi
    middle = poses[:-1, 2] + 0.5 * turn
    chord = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    return np.stack([chord / np.sinc(0.5 * turn / np.pi), turn], axis=1)
