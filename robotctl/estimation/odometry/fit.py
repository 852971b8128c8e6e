"""Unknowns and residuals of a calibration of odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize  # type: ignore[import-untyped]
from scipy.stats import t as student  # type: ignore[import-untyped]

from robotctl.estimation.odometry.innovations import OUTLIER, whitened_innovations
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun, guess_start
from robotctl.model.drives.odometry_noise import MotionNoise

Array: TypeAlias = NDArray[np.float64]

CONFIDENCE = 0.95

_CHANGE_SIGMA = 0.15
"""Prior standard deviation of a change."""

_REST_SIGMA = 0.3
"""Prior standard deviation of the lever arm [m] and the delay [s]."""

_NOISE_FOLD = 300.0
"""The noises are searched up to this factor above and below their initial values."""

_NOISE_SIGMA = 2.0
"""Prior standard deviation of a noise's logarithm."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Prior of the reference.

    Parameters
    ----------
    sigma_m, sigma_rad, sigma_s
        Standard deviation of its position on each axis [m], its heading [rad] and its time [s].
    fixed
        Whether these are known (a tape measure); otherwise they are initial values of an estimate.
    follows_base
        Whether it measures `base` itself without delay; otherwise lever arm and delay are
        estimated.
    """

    sigma_m: float = 0.01
    sigma_rad: float = 0.02
    sigma_s: float = 0.02
    fixed: bool = False
    follows_base: bool = False

    @property
    def sigmas(self) -> tuple[float, float, float]:
        """The three deviations [m, rad, s]."""
        return self.sigma_m, self.sigma_rad, self.sigma_s


class OdometryFit:
    """The unknowns and the data that they must explain.

    The numbers: the changes of the drive, 2 of the lever arm, the delay, 3 for each unknown start.
    """

    def __init__(
        self, model: OdometryModel, runs: Sequence[OdometryRun], reference: Reference
    ) -> None:
        self.model = model
        self.runs = tuple(runs)
        self.reference = reference
        self.references = sum(len(run.reference) for run in self.runs)
        unknown = sum(run.start is None for run in self.runs)
        self._starts = model.size + 3
        self._before = np.array([_CHANGE_SIGMA] * model.size + [_REST_SIGMA] * 3)
        self.free = np.ones(self._starts + 3 * unknown, dtype=bool)
        self.free[model.size : self._starts] = not reference.follows_base
        self._headings = any(np.isfinite(run.reference[:, 2]).any() for run in self.runs)

    @property
    def size(self) -> int:
        """Number of free unknowns."""
        return int(np.count_nonzero(self.free))

    def begin(self) -> Array:
        """Return the start of the search."""
        values = [0.0] * self._starts
        for run in self.runs:
            if run.start is None:
                pose = guess_start(run, self.model.moves(self.model.nothing, run.rolled))
                values += [pose.x_m, pose.y_m, pose.theta_rad]
        return np.array(values)

    def noise_begin(self, noise: MotionNoise) -> Array:
        """Return the logarithms of the noises: e, f, g, and of the reference unless it is known."""
        values = [noise.e_m_per_sqrt_m, noise.f_rad_per_sqrt_m, noise.g_rad_per_sqrt_rad]
        if not self.reference.fixed:
            values += [*self.reference.sigmas]
        return np.log(np.maximum(values, 1e-6))

    def innovations(self, values: Array, noises: Array) -> tuple[Array, float]:
        """Return all white innovations, (k,), and the sum of log determinants."""
        growth = np.exp(2.0 * noises[:3])
        if self.reference.fixed:
            variance = np.square(self.reference.sigmas)
        else:
            variance = np.exp(2.0 * noises[3:6])
        size = self.model.size
        rows, log_det, unknown = [], 0.0, self._starts
        for run in self.runs:
            moves = self.model.moves(values[:size], run.rolled)
            if run.start is None:
                start = values[unknown : unknown + 3]
                unknown += 3
            else:
                start = np.array([run.start.x_m, run.start.y_m, run.start.theta_rad])
            out, part = whitened_innovations(
                run.stamps_s,
                moves,
                start,
                np.square(np.array(run.start_sigma)),
                growth,
                run.reference_s,
                run.reference,
                run.speed_m_s(moves),
                variance,
                values[size : size + 2],
                float(values[size + 2]),
                OUTLIER,
            )
            seen = np.isfinite(run.reference)
            rows.append(out[seen])
            log_det += part
        return np.concatenate(rows), log_det

    def _residuals(self, values: Array, noises: Array) -> Array:
        """Return innovations, and the deviations of the numbers from their prior."""
        weak = values[: self._starts] / self._before
        known = weak[self.free[: self._starts]]
        return np.concatenate([self.innovations(values, noises)[0], known])

    def drive_step(self, values: Array, noises: Array) -> Array:
        """Return the numbers that fit best with given noises."""
        high = np.full(len(values), np.inf)
        low = -high
        low[: self.model.size], high[: self.model.size] = self.model.bounds
        full = values.copy()

        def residuals(part: Array) -> Array:
            full[self.free] = part
            return self._residuals(full, noises)

        solution = least_squares(
            residuals,
            values[self.free],
            bounds=(low[self.free], high[self.free]),
            x_scale="jac",
            loss="huber",
            f_scale=OUTLIER,
        )
        full[self.free] = solution.x
        return full

    def noise_step(self, values: Array, noises: Array, prior: MotionNoise) -> Array:
        """Return the logarithms of the noises that are most likely with given numbers."""
        middle = self.noise_begin(prior)
        reach = math.log(_NOISE_FOLD)
        solution = minimize(
            lambda x: self._cost(values, x) + float(np.sum(((x - middle) / _NOISE_SIGMA) ** 2)),
            noises,
            bounds=[(x - reach, x + reach) for x in middle],
            method="L-BFGS-B",
        )
        return np.asarray(solution.x)

    def _cost(self, values: Array, noises: Array) -> float:
        """Return -2 log likelihood, growing only linearly for outliers."""
        r, log_det = self.innovations(values, noises)
        size = np.abs(r)
        square = np.where(size <= OUTLIER, r * r, OUTLIER * (2.0 * size - OUTLIER))
        return float(np.sum(square)) + log_det

    def covariance(self, values: Array, noises: Array) -> tuple[Array, float]:
        """Return the covariance of the numbers, 0 if not free, and Student's quantile."""
        J = self._jacobian(values, noises)
        r = np.clip(self.innovations(values, noises)[0], -OUTLIER, OUTLIER)
        dof = max(1, len(r) - self.size)
        spread = max(1.0, float(r @ r) / dof)
        covariance = np.zeros((len(values), len(values)))
        covariance[np.ix_(self.free, self.free)] = np.linalg.inv(J.T @ J) * spread
        return covariance, float(student.ppf(0.5 + 0.5 * CONFIDENCE, dof))

    def _jacobian(self, values: Array, noises: Array) -> Array:
        """Return the derivatives of the residuals by the free numbers."""
        columns = []
        for i in np.flatnonzero(self.free):
            h = np.zeros(len(values))
            h[i] = 1e-5
            ahead, back = self._residuals(values + h, noises), self._residuals(values - h, noises)
            columns.append((ahead - back) / 2e-5)
        return np.stack(columns, axis=1)

    def noise_fold(self, values: Array, noises: Array) -> Array:
        """Return the factors of the intervals of e, f and g, from the likelihood's curvature."""
        n, h = len(noises), 0.1
        steps = h * np.eye(n)
        H = np.empty((n, n))
        for i in range(n):
            for j in range(i + 1):
                corners = (
                    self._cost(values, noises + a * steps[i] + b * steps[j]) * a * b
                    for a in (-1, 1)
                    for b in (-1, 1)
                )
                H[i, j] = H[j, i] = sum(corners) / (4 * h * h) / 2.0
        # the weak knowledge before counts too: it keeps the inverse finite
        H += np.eye(n) / _NOISE_SIGMA**2
        if np.linalg.eigvalsh(H).min() <= 0.0:
            return np.full(3, np.inf)
        sigma = np.sqrt(np.diag(np.linalg.inv(H)))[:3]
        fold: Array = np.exp(1.96 * sigma)
        fold[sigma > 0.4 * _NOISE_SIGMA] = np.inf
        return fold
