"""EKF-SLAM of a recorded drive by its sightings of landmarks.

    drive = RecordedSlam(recording, LandmarkConfig(), start, "joint")
    for step in drive.steps():
        step.estimate, step.share
    drive.run.slam.names, drive.run.slam.past(drive.past_ns[0])

gives the estimate at each time at which something was seen, with what was seen until then; and in
the end the whole drive, with all that was seen. The work is done between steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.localisation import CountedOdometry
from robotctl.estimation.landmarks.prediction import Prediction
from robotctl.estimation.slam.ekf_slam.bookkeeping import Association, LandmarkBook
from robotctl.estimation.slam.ekf_slam.calibrated import CalibratedSlam
from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.filter import NEW
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.recording import Recording, Sighting

Array: TypeAlias = NDArray[np.float64]

STEP_S: Final = 0.2
"""Longest step of the prediction [s]."""
PAST_POSES: Final = 150
"""About how many poses are kept of a drive: evenly along its way."""


@dataclass(frozen=True, slots=True, eq=False)
class SlamStep:
    """The estimate at one time.

    Parameters
    ----------
    estimate, nis
        Of the pose; of the sightings of now that were of known landmarks, None without any.
    share
        How much of the recording is done, 0 to 1.
    """

    estimate: PoseEstimate
    nis: float | None
    share: float


class RecordedSlam:
    """SLAM along a recording.

    Parameters
    ----------
    recording
        With motion and sightings.
    config
        Priors of odometry and camera.
    start
        Prior of the pose, and the time at which it begins.
    association
        How it is found which landmark is seen.

    Raises
    ------
    ValueError
        If the recording has no motion.
    """

    def __init__(
        self,
        recording: Recording,
        config: LandmarkConfig,
        start: PoseEstimate,
        association: Association,
    ) -> None:
        self._odometry = CountedOdometry(recording)
        self._recording = recording
        self._begin_ns = start.stamp_ns
        self.run = CalibratedSlam(config, start)
        """The filter."""
        self.book = LandmarkBook(association)
        """Count of the sightings of each landmark."""
        self.past_ns: list[int] = []
        """Times of the poses that are kept [ns]."""
        self.seen: list[tuple[int, int | str, Sighting]] = []
        """Time [ns], name of the landmark, and sighting of each that was used."""

    def steps(self) -> Iterator[SlamStep]:
        """Follow the recording; see above."""
        begin_ns, end_ns = self._begin_ns, self._odometry.end_ns
        seen: dict[int, list[Sighting]] = {}
        for each in self._recording.sightings:
            if begin_ns <= each.stamp_ns <= end_ns:
                seen.setdefault(each.stamp_ns, []).append(each)
        grid = np.arange(begin_ns, end_ns, round(1e9 * STEP_S), dtype=np.int64)
        stamps_ns = np.union1d(grid, np.array([*seen, end_ns], dtype=np.int64)).tolist()
        apart_m = self._way_m(stamps_ns) / PAST_POSES
        self._remember(begin_ns)
        since_m = 0.0
        for before_ns, stamp_ns in pairwise([begin_ns, *stamps_ns]):
            delay_s = self.run.delay_s
            begin, end = (self._odometry.at(at, delay_s) for at in (before_ns, stamp_ns))
            since_m += abs(self.run.predict(stamp_ns, begin, end).distance_m)
            if since_m > apart_m or stamp_ns == end_ns:
                self._remember(stamp_ns)
                since_m = 0.0
            nis = self._see(stamp_ns, seen[stamp_ns]) if stamp_ns in seen else None
            self.book.prune(self.run.slam, stamp_ns)
            share = (stamp_ns - begin_ns) / max(1, end_ns - begin_ns)
            yield SlamStep(self.run.slam.estimate(stamp_ns), nis, share)

    def past(self) -> Array:
        """Return the covariances of the poses that were kept, with all that was seen, (k, 3, 3)."""
        return np.array([self.run.slam.past(stamp_ns)[1] for stamp_ns in self.past_ns])

    def motion(self, begin_ns: int, end_ns: int) -> Prediction:
        """Return the motion from one time to another [ns], from pose 0 on, as calibrated now."""
        x = self.run.slam.x_v.copy()
        x[:3] = 0.0
        begin, end = (self._odometry.at(at, self.run.delay_s) for at in (begin_ns, end_ns))
        return self.run.robot.prediction(x, begin, end, 1e-9 * (end_ns - begin_ns))

    def _way_m(self, stamps_ns: list[int]) -> float:
        """Return how far odometry went [m]."""
        counted = [self._odometry.at(stamp_ns, 0.0).distance_m for stamp_ns in stamps_ns]
        return float(np.sum(np.abs(np.diff(counted))))

    def _remember(self, stamp_ns: int) -> None:
        if self.past_ns[-1:] != [stamp_ns]:
            self.run.slam.remember(stamp_ns)
            self.past_ns.append(stamp_ns)

    def _see(self, stamp_ns: int, sightings: list[Sighting]) -> float | None:
        """Correct by the sightings of now, and add those that are new; return their NIS."""
        slam = self.run.slam
        z = np.array([[each.range_m, each.bearing_rad] for each in sightings])
        names = [each.landmark for each in sightings]
        which = self.book.which(slam, CAMERA_POINT, z, self.run.noise(z), names)
        known = which >= 0
        nis = self.run.correct(which[known], z[known]) if known.any() else None
        for number, each, row in zip(which.tolist(), sightings, z, strict=True):
            if number >= 0:
                name = slam.names[number]
            elif number == NEW:
                name = self.book.name(each.landmark)
                self.run.add(name, row)
            else:
                self.book.unused += 1
                continue
            self.book.saw(name, stamp_ns)
            self.seen.append((stamp_ns, name, each))
        return nis
