"""EKF-SLAM: the pose of a robot and a map of features, estimated together.

    slam = EkfSlam(np.zeros(3), np.zeros((3, 3)))
    slam.move(distance_m, turn_rad, noise)
    slam.sight(POINT, ["tree", "lamp"], z, R)                    # the sensor knows the names
    which = slam.associate(POINT, z, R)                          # it does not
    slam.update(POINT, which, z, R)                              # of those that are known
    slam.add(POINT, "bush", z, R)

Source: Smith, Self, Cheeseman: Estimating uncertain spatial relationships in robotics, 1990; Thrun,
Burgard, Fox: Probabilistic Robotics, chapter 10. World coordinates are those in which the start is
given; with a start without doubt, P = 0, they are the robot's own.

A textbook EKF linearises one and the same feature at a different estimate each time. So it takes a
turn of the whole, robot and map, which nothing measures, for measured, and becomes too sure of its
heading. With `invariant` the covariance is that of errors which turn with the heading: positions as
seen by a world that is turned by the heading's error. Their Jacobians leave position and heading of
the whole unobservable at whatever estimates (Barrau, Bonnabel: An EKF-SLAM algorithm with
consistency properties, arXiv 1510.06263, 2015; Zhang et al.: Convergence and consistency analysis
for a 3-D invariant-EKF SLAM, IEEE RA-L 2(2), 2017), as observability-constrained Jacobians do
(Huang, Mourikis, Roumeliotis, IJRR 29(5), 2010), but not at first estimates, which may be far off.
In the coordinates of this filter that is the same filter with two differences after each update: a
correction moves positions along the exponential of SE(2), and the covariance follows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.kalman.chi_squared import chi2_quantile
from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian
from robotctl.estimation.slam.ekf_slam.association import (
    NONE,
    Gates,
    joint_compatibility,
    nearest_neighbour,
    pair_nis,
    unambiguous,
)
from robotctl.estimation.slam.ekf_slam.features import HEADING, PLACE, FeatureKind
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance, pose_jacobian
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

NEW: Final = -2
"""Association of a measurement with no feature of the map."""
PAST_POSE: Final = ("place", "heading")
"""Beginnings of the names of the two features of a past pose."""
_POSE: Final = 3


class EkfSlam:
    """The joint belief in a robot and in features, and what measurements do to it.

    Parameters
    ----------
    x_v, P_xx
        The robot's state (nv,), which begins with x [m], y [m], theta [rad], and its covariance.
    invariant
        Whether nothing can be learned of a turn of the whole, see above; False: as in textbooks.
    gates
        Limits of association.
    considered
        Which of the robot's states are not estimated, though their doubt counts: those of which the
        measurements only seem to tell (Schmidt: Application of state-space methods to navigation
        problems, Advances in Control Systems 3, 1966).
    """

    def __init__(
        self,
        x_v: Array,
        P_xx: Array,
        *,
        invariant: bool = True,
        gates: Gates | None = None,
        considered: Sequence[int] = (),
    ) -> None:
        self.belief = GrowingGaussian(x_v, P_xx)
        """State and covariance of the robot, then of two numbers for each feature."""
        self.nv = len(x_v)
        """Size of the robot's state."""
        self.names: list[int | str] = []
        """Name of each feature."""
        self.kinds: list[FeatureKind] = []
        """Kind of each feature."""
        self.gates = gates or Gates()
        self._robot = np.arange(self.nv)
        self._considered = np.array(considered, np.int64)
        self._invariant = invariant
        self._index: dict[int | str, int] = {}
        self._turning = self._turning_columns()

    @property
    def x_v(self) -> Array:
        """The robot's state (nv,), a view."""
        return self.belief.x[: self.nv]

    @property
    def features(self) -> Array:
        """The features (k, 2), a view."""
        return self.belief.x[self.nv :].reshape(-1, 2)

    @property
    def pose(self) -> SE2:
        """`base` in `world`."""
        x, y, theta = self.x_v[:_POSE].tolist()
        return SE2(x, y, wrap_angle(theta))

    def pose_covariance(self) -> Array:
        """Return the covariance of x [m], y [m], theta [rad], (3, 3)."""
        return self.belief.block(self._robot[:_POSE])

    def covariance(self, feature: int) -> Array:
        """Return the covariance of a feature (2, 2).

        Raises
        ------
        IndexError
            If there is no such feature.
        """
        return self.belief.block(self._column(feature) + np.arange(2))

    def estimate(self, stamp_ns: int) -> PoseEstimate:
        """Return the pose and its covariance, of a time [ns]."""
        return PoseEstimate(
            stamp_ns, self.pose, self.pose_covariance(), LocalisationStatus.LOCALISED
        )

    def nees(self, truth: SE2) -> float:
        """Return the squared error of the pose, normalised by its covariance; 3 dimensions.

        With `invariant` the error is that in the tangent space in which the filter corrects.
        """
        nees = tangent_nees if self._invariant else _nees
        return nees(self.pose, self.pose_covariance(), truth)

    def index(self, name: int | str) -> int | None:
        """Return which feature has a name; None if none has."""
        return self._index.get(name)

    def move(self, distance_m: float, turn_rad: float, noise: MotionNoise) -> None:
        """Move a robot whose state is its pose by an arc that odometry counted [m], [rad]."""
        pose = self.pose
        end = arc(pose, distance_m, turn_rad)
        self.predict(
            np.array([end.x_m, end.y_m, end.theta_rad]),
            pose_jacobian(pose, distance_m, turn_rad),
            added_covariance(pose, distance_m, turn_rad, noise),
        )

    def predict(self, x_v: Array, F: Array, Q: Array) -> None:
        """Move the robot to a state (nv,).

        Parameters
        ----------
        F, Q
            Jacobian of the new state by the old one, and the noise of the motion, (nv, nv).
        """
        self.belief.predict(x_v, F, Q)

    def sight(
        self, kind: FeatureKind, names: Sequence[int | str], z: Array, R: Array
    ) -> float | None:
        """Correct by measurements of m features with names, and add those that are new.

        Parameters
        ----------
        z, R
            Measurements (m, 2), all of one time, and their noises (m, 2, 2).

        Returns
        -------
        NIS of those that were known, of twice their number of dimensions; None without any.
        """
        index = self._index
        known = [a for a, name in enumerate(names) if name in index]
        nis = None
        if known:
            which = np.array([index[names[a]] for a in known])
            nis = self.update(kind, which, z[known], R[known])
        for a, name in enumerate(names):
            if name not in index:
                self.add(kind, name, z[a], R[a])
        return nis

    def update(self, kind: FeatureKind, which: Indices, z: Array, R: Array) -> float:
        """Correct by measurements of m known features, all of one time; return their NIS.

        Parameters
        ----------
        which
            The features, (m,).
        z, R
            Measurements (m, 2), and their noises (m, 2, 2).

        Raises
        ------
        ValueError
            If the covariance of the innovations is not positive definite: noises without any.
        """
        expected, columns, J = self.expected(kind, which)
        off = kind.residual(z, expected)
        if not len(self._considered):
            return self.belief.update(columns, J, off, R, self._turning)
        x, P = self.x_v[self._considered], self.belief.block(self._considered)
        nis = self.belief.update(columns, J, off, R, self._turning)
        self.x_v[self._considered] = x
        self.belief.set_block(self._considered, P)
        return nis

    def expected(self, kind: FeatureKind, which: Indices) -> tuple[Array, Indices, Array]:
        """Return what features (m,) should be measured as, and on what that depends.

        Returns
        -------
        Expected measurements (m, 2); columns of the state (m, nv + 2), and the Jacobians by these
        (m, 2, nv + 2).
        """
        expected, by_robot, by_feature = kind.expected(self.x_v, self.features[which])
        return expected, *_joined(which, by_robot, by_feature)

    def add(self, kind: FeatureKind, name: int | str, z: Array, R: Array) -> int:
        """Add the feature of a measurement (2,) with the noise R (2, 2); return its number."""
        y = kind.initial(self.x_v, z)
        _, by_robot, by_feature = kind.expected(self.x_v, y[np.newaxis])
        inverse = np.linalg.inv(by_feature[0])
        return self._append(kind, name, y, -inverse @ by_robot[0], inverse @ R @ inverse.T)

    def remember(self, name: int | str) -> None:
        """Keep the present pose, which what is measured later then corrects as well.

        It is two features that are never measured: `PLACE`, and `HEADING` with a second number
        that is 0. `past` returns them.
        """
        nothing = np.zeros((2, 2))
        by_pose = np.zeros((2, 2, self.nv))
        by_pose[0, 0, 0] = by_pose[0, 1, 1] = by_pose[1, 0, 2] = 1.0
        x, y, theta = self.x_v[:_POSE].tolist()
        self._append(PLACE, f"{PAST_POSE[0]} {name}", np.array([x, y]), by_pose[0], nothing)
        self._append(HEADING, f"{PAST_POSE[1]} {name}", np.array([theta, 0.0]), by_pose[1], nothing)

    def past(self, name: int | str) -> tuple[SE2, Array]:
        """Return a remembered pose as it is estimated now, and its covariance (3, 3).

        Raises
        ------
        KeyError
            If none was remembered by this name.
        """
        place, heading = (self._column(self._index[f"{what} {name}"]) for what in PAST_POSE)
        at = np.array([place, place + 1, heading])
        x, y, theta = self.belief.x[at].tolist()
        return SE2(x, y, wrap_angle(theta)), self.belief.block(at)

    def _append(
        self, kind: FeatureKind, name: int | str, y: Array, by_robot: Array, noise: Array
    ) -> int:
        """Add a feature; return its number."""
        self.belief.append(y, self._robot, by_robot, noise)
        number = len(self.names)
        self.names.append(name)
        self.kinds.append(kind)
        self._index[name] = number
        self._turning = self._turning_columns()
        return number

    def remove(self, which: int) -> None:
        """Forget a feature; the last one takes its number.

        Raises
        ------
        IndexError
            If there is no such feature.
        """
        self.belief.remove(self._column(which), 2)
        del self._index[self.names[which]]
        self.names[which], self.kinds[which] = self.names[-1], self.kinds[-1]
        self.names.pop()
        self.kinds.pop()
        if which < len(self.names):
            self._index[self.names[which]] = which
        self._turning = self._turning_columns()

    def _column(self, feature: int) -> int:
        """Return the first column of a feature; raise `IndexError` if there is none."""
        if not 0 <= feature < len(self.names):
            raise IndexError(f"feature {feature}: there are {len(self.names)}")
        return self.nv + 2 * feature

    def _turning_columns(self) -> Indices:
        """Return the first columns of the positions whose errors turn with the heading."""
        if not self._invariant:
            return np.empty(0, np.int64)
        places = [self.nv + 2 * number for number, kind in enumerate(self.kinds) if kind.turns]
        return np.array([0, *places], np.int64)

    def associate(
        self, kind: FeatureKind, z: Array, R: Array, method: Literal["nearest", "joint"] = "joint"
    ) -> Indices:
        """Return of which feature each of m measurements is, all of one time.

        Parameters
        ----------
        z, R
            Measurements (m, 2), and their noises (m, 2, 2).
        method
            See `association`.

        Returns
        -------
        (m,): a feature; `NEW` where it is far from all; `NONE` where it is too far from one to be
        of it and too near to be of another, or as well may be of another.
        """
        which = np.flatnonzero([each is kind for each in self.kinds])
        if len(which) == 0:
            return np.full(len(z), NEW)
        expected, columns, J = self.expected(kind, which)
        off = kind.residual(
            np.repeat(z, len(which), axis=0), np.tile(expected, (len(z), 1))
        ).reshape(len(z), len(which), 2)
        each = self.belief.innovation_covariances(columns, J)
        nis = pair_nis(off, each, R)
        gate = chi2_quantile(self.gates.compatible, 2)
        if method == "nearest":
            found = nearest_neighbour(nis, gate)
        else:
            near = np.flatnonzero((nis <= gate).any(axis=0))
            G = self.belief.joint_innovation_covariance(columns[near], J[near])
            found = joint_compatibility(off[:, near], G, R, nis[:, near], self.gates.compatible)
            found = np.where(found >= 0, near[found] if len(near) else NONE, NONE)
            found = unambiguous(found, nis, each, R, self.gates.ratio)
        is_far = (nis > chi2_quantile(self.gates.new, 2)).all(axis=1)
        result: Indices = np.where(found >= 0, which[found], np.where(is_far, NEW, NONE))
        return result


@compiled
def _joined(which: Indices, by_robot: Array, by_feature: Array) -> tuple[Indices, Array]:
    """Return the columns of robot and features (m, nv + 2), and the Jacobians by these."""
    m, _, nv = by_robot.shape
    columns, J = np.empty((m, nv + 2), np.int64), np.empty((m, 2, nv + 2))
    for a in range(m):
        for c in range(nv):
            columns[a, c] = c
            J[a, 0, c], J[a, 1, c] = by_robot[a, 0, c], by_robot[a, 1, c]
        for c in range(2):
            columns[a, nv + c] = nv + 2 * which[a] + c
            J[a, 0, nv + c], J[a, 1, nv + c] = by_feature[a, 0, c], by_feature[a, 1, c]
    return columns, J


def tangent_nees(pose: SE2, P: Array, truth: SE2) -> float:
    """Return the squared error of a pose in the tangent space of SE(2), normalised; 3 dimensions.

    The error (dx, dy, dtheta) moves `pose` along the exponential to the truth, in `world`: for a
    heading that is far off it is the one of which P (3, 3) can be the covariance.
    """
    turn = wrap_angle(truth.theta_rad - pose.theta_rad)
    x, y, _ = SE2(truth.x_m - pose.x_m, truth.y_m - pose.y_m, turn).log()
    return _normalised(np.array([x, y, turn]), P)


def _nees(pose: SE2, P: Array, truth: SE2) -> float:
    """Return the squared error of a pose, normalised by its covariance."""
    turn = wrap_angle(truth.theta_rad - pose.theta_rad)
    return _normalised(np.array([truth.x_m - pose.x_m, truth.y_m - pose.y_m, turn]), P)


def _normalised(error: Array, P: Array) -> float:
    return float(error @ np.linalg.solve(P, error))
