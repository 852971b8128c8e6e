"""EKF-SLAM of points by a camera and an odometry that are calibrated on the way.

As `landmarks.ekf.LandmarkEkf`, but nobody knows where the landmarks are, or which is seen. Without
a known map nothing tells the scale of the ranges from that of the map; what seems to tell is
rounding of the linearisation. So this state is considered and not estimated.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.models import OdometryReading, S
from robotctl.estimation.landmarks.prediction import CalibratedRobot, Prediction
from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.model.geometry.pose_estimate import PoseEstimate

Array: TypeAlias = NDArray[np.float64]

_SCALES: Final = (int(S.RANGE_SCALE),)


class CalibratedSlam:
    """The joint belief in pose, calibration and landmarks of a robot with a camera.

    Parameters
    ----------
    config
        Priors of odometry and camera.
    start
        Prior of the pose.
    """

    def __init__(self, config: LandmarkConfig, start: PoseEstimate) -> None:
        self.robot = CalibratedRobot(config, start)
        """Motion and noises."""
        self.slam = EkfSlam(*self.robot.start, considered=_SCALES)
        """The filter."""

    @property
    def delay_s(self) -> float:
        """How long before a time its motion is in the odometry [s]."""
        return float(self.slam.x_v[S.DELAY])

    def noise(self, z: Array) -> Array:
        """Return the noises of measurements (m, 2), as learned, (m, 2, 2)."""
        return self.robot.noise.of_sightings(z[:, 0])

    def predict(self, stamp_ns: int, begin: OdometryReading, end: OdometryReading) -> Prediction:
        """Move until a time [ns]; see `CalibratedRobot.move`."""
        return self.robot.move(self.slam.belief, stamp_ns, begin, end)

    def correct(self, which: NDArray[np.int64], z: Array) -> float:
        """Correct by measurements (m, 2) of known features (m,), all of now; return their NIS."""
        slam, learned = self.slam, self.robot.noise
        R = self.noise(z)
        expected, columns, J = slam.expected(CAMERA_POINT, which)
        innovations = CAMERA_POINT.residual(z, expected)
        G = slam.belief.innovation_covariances(columns, J)
        nis = slam.update(CAMERA_POINT, which, z, R)
        learned.learn_motion(innovations, J[:, :, : slam.nv], G, R)
        expected, _, J = slam.expected(CAMERA_POINT, which)
        J[:, :, _SCALES] = 0.0  # the features have it too, and it does not show
        left = slam.belief.innovation_covariances(columns, J)
        learned.learn_sightings(CAMERA_POINT.residual(z, expected), left, learned.guess(z[:, 0]))
        return nis

    def add(self, name: int | str, z: Array) -> int:
        """Add the feature of a measurement (2,); return its number."""
        return self.slam.add(CAMERA_POINT, name, z, self.noise(z[np.newaxis])[0])
