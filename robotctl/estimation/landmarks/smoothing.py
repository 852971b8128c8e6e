"""The drive of a landmark filter with all that was seen, before a time and after it.

    smoother = LandmarkSmoother(config)
    for step in localise_by_landmarks(recording, config, start):
        smoother.add(step)
    smoothed(recording, config, start, smoother)

A filter that sees no landmark for a minute drives by an odometry that it may not have calibrated
yet. What it sees afterwards tells where it was meanwhile: the backward pass of Rauch, Tung,
Striebel: Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3(8), 1965, about the
linearisation of the filter; then filter and backward pass again about what that gave (Bell: The
iterated Kalman smoother as a Gauss-Newton method, SIAM Journal on Optimization 4(3), 1994).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.ekf import stated
from robotctl.estimation.landmarks.localisation import LandmarkStep, localise_by_landmarks
from robotctl.estimation.landmarks.models import S
from robotctl.estimation.landmarks.prediction import between_states
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.recording import Recording

Array: TypeAlias = NDArray[np.float64]

_AGAIN: Final = 2
"""Passes after the first; the second one matters where the filter had to find the pose again."""


class _Step(NamedTuple):
    """A step of the filter, 3 kB: F and Q but the parts that are always 1 and 0.

    Parameters
    ----------
    stamp_ns
        Its time [ns].
    x, P
        Belief with what was seen until then: mean (n,), lower triangle of the covariance.
    predicted
        Mean before the sightings of its time, (n,).
    F_pose, F_wander
        Jacobian of the predicted pose (3, n), and that of the wander, by the state before.
    Q_pose, Q_diagonal
        Noise of the prediction: of the pose (3, 3), and the variances of all (n,).
    restarts
        How often the filter had found the pose again.
    is_lost
        Whether the sightings contradicted the belief.
    """

    stamp_ns: int
    x: Array
    P: Array
    predicted: Array
    F_pose: Array
    F_wander: float
    Q_pose: Array
    Q_diagonal: Array
    restarts: int
    is_lost: bool

    def covariance(self) -> Array:
        """Return P whole, (n, n)."""
        n = len(self.x)
        P = np.zeros((n, n))
        P[np.tril_indices(n)] = self.P
        return P + np.tril(P, -1).T

    def jacobian(self) -> Array:
        """Return F, (n, n)."""
        F = np.eye(len(self.x))
        F[:3], F[S.WANDER, S.WANDER] = self.F_pose, self.F_wander
        return F

    def noise(self) -> Array:
        """Return Q, (n, n)."""
        Q = np.diag(self.Q_diagonal)
        Q[:3, :3] = self.Q_pose
        return Q


class LandmarkSmoother:
    """Memory of a filter's steps, and the drive that all of them together tell.

    Parameters
    ----------
    config
        Settings of the filter.
    """

    def __init__(self, config: LandmarkConfig) -> None:
        self._config = config
        self._steps: list[_Step] = []

    def add(self, step: LandmarkStep) -> None:
        """Take in a step of the filter, before it makes the next."""
        ekf, made = step.ekf, step.made
        P = ekf.P
        self._steps.append(
            _Step(
                step.estimate.stamp_ns,
                ekf.x,
                P[np.tril_indices(len(P))],
                made.x,
                made.F[:3].copy(),
                float(made.F[S.WANDER, S.WANDER]),
                made.Q[:3, :3].copy(),
                np.diag(made.Q).copy(),
                ekf.restarts,
                step.estimate.status is LocalisationStatus.LOST,
            )
        )

    def states(self) -> Array:
        """Return the mean at each step, (steps, n), through restarts too."""
        return np.array([x for _, x, _ in self._backwards(through_restarts=True)][::-1])

    def estimates(self) -> list[PoseEstimate]:
        """Return the estimate at each step's time, in their order; LOST where the filter was.

        Nothing passes a restart of the filter backwards: the belief before it was wrong.
        """
        return [
            stated(self._config, step.stamp_ns, x, P[:3, :3], is_lost=step.is_lost)
            for step, x, P in self._backwards(through_restarts=False)
        ][::-1]

    def _backwards(self, *, through_restarts: bool) -> Iterator[tuple[_Step, Array, Array]]:
        """Yield each step, the last one first, with mean and covariance by all that was seen."""
        after: _Step | None = None
        x, P = np.empty(0), np.empty((0, 0))
        for step in reversed(self._steps):
            if after is None or (after.restarts != step.restarts and not through_restarts):
                x, P = step.x, step.covariance()
            else:
                x, P = _stepped_back(step, after, x, P)
            yield step, x, P
            after = step


def smoothed(
    recording: Recording, config: LandmarkConfig, start: PoseEstimate, first: LandmarkSmoother
) -> list[PoseEstimate]:
    """Return the estimate at each step of a drive by all that was seen.

    Parameters
    ----------
    recording, config, start
        The drive, priors, and the pose where it begins.
    first
        Memory of the filter's first pass.
    """
    smoother = first
    for _ in range(_AGAIN):
        about, smoother = smoother.states(), LandmarkSmoother(config)
        for step in localise_by_landmarks(recording, config, start, about):
            smoother.add(step)
    return smoother.estimates()


def _stepped_back(step: _Step, after: _Step, x: Array, P: Array) -> tuple[Array, Array]:
    """Return the belief of a step from the smoothed one of the step after it, x and P."""
    before, F = step.covariance(), after.jacobian()
    predicted = F @ before @ F.T + after.noise()
    gain = np.linalg.solve(predicted, F @ before).T
    off = between_states(after.predicted, x)
    return step.x + gain @ off, before + gain @ (P - predicted) @ gain.T
