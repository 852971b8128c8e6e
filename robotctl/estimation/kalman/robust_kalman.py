"""filterpy's extended Kalman filter, guarded against measurements that do not fit.

Predict and update, the gain, the covariance in Joseph form, are those of
`filterpy.kalman.ExtendedKalmanFilter`. This adds what a robot needs around them:

- Huber weighting. An innovation beyond `huber_sigma` standard deviations is taken with its
  covariance S enlarged by the factor |innovation| / huber_sigma: its pull stays constant instead of
  growing, and it is never thrown away for being unlikely. A hard 99 % gate discards it, and an
  overconfident filter then never learns of its error. (Huber 1964; Karlgaard & Schaub 2007, doi
  10.2514/1.27499.)
- A gate for gross outliers alone, far out, that opens by itself: each one that is kept out enlarges
  the covariance by `opening`, so a run of them is accepted in the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.chi_squared import chi2_quantile

Array: TypeAlias = NDArray[np.float64]
Residual: TypeAlias = Callable[[Array, Array], Array]


@dataclass(frozen=True, slots=True)
class RobustConfig:
    """Treatment of large innovations.

    Parameters
    ----------
    huber_sigma
        Normalised innovation beyond which the weight falls, > 0; as for one dimension, more
        dimensions use the same probability.
    gross_sigma
        Normalised innovation that is kept out, > huber_sigma; inf: none.
    opening
        Factor on the covariance with each measurement that was kept out, > 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    huber_sigma: float = 2.0
    gross_sigma: float = 8.0
    opening: float = 1.3

    def __post_init__(self) -> None:
        if not 0.0 < self.huber_sigma < math.inf:
            raise ValueError(f"huber_sigma: {self.huber_sigma} found, a finite number > 0 allowed")
        if not self.gross_sigma > self.huber_sigma:
            raise ValueError(
                f"gross_sigma: {self.gross_sigma} found, more than huber_sigma allowed "
                f"({self.huber_sigma})"
            )
        if not 1.0 < self.opening < math.inf:
            raise ValueError(f"opening: {self.opening} found, a finite number > 1 allowed")

    def weight(self, nis: float, dof: int) -> float:
        """Return the weight of an innovation by its nis and dimension; 0: it is kept out."""
        huber, gross = _limits(self.huber_sigma, self.gross_sigma, dof)
        if nis <= huber:
            return 1.0
        # Beyond the limit the influence of an innovation stays constant.
        return 0.0 if nis > gross else math.sqrt(huber / nis)


@cache
def _limits(huber_sigma: float, gross_sigma: float, dof: int) -> tuple[float, float]:
    """Return the nis that are as unlikely as these sigmas in one dimension."""
    inside = math.erf(huber_sigma / math.sqrt(2.0))
    huber = chi2_quantile(inside, dof) if inside < 1.0 else huber_sigma**2
    return huber, huber * (gross_sigma / huber_sigma) ** 2


@dataclass(frozen=True, slots=True)
class Innovation:
    """How well one measurement agreed with its prediction.

    Parameters
    ----------
    stamp_ns
        Time of the measurement [ns].
    sensor
        The sensor.
    nis
        Normalised innovation squared, with the covariance before any weighting.
    dof
        Its degrees of freedom.
    weight
        1: taken as it is; less: taken with a larger covariance; 0: kept out.
    """

    stamp_ns: int
    sensor: str
    nis: float
    dof: int
    weight: float


@cache
def _filter_class() -> Any:
    """Return filterpy's filter, given the predicted state by the caller that knows the motion."""
    # It loads scipy.stats, which takes half a second: only those who filter wait for it.
    from filterpy.kalman import (  # type: ignore[import-untyped]  # noqa: PLC0415
        ExtendedKalmanFilter,
    )

    class Filter(ExtendedKalmanFilter):  # type: ignore[misc]
        def predict_x(self, u: Any = 0) -> None:
            """Take `u` as the state after the motion: filterpy's hook for a non-linear model."""
            self.x = u

    return Filter


class RobustKalman:
    """State and covariance with robust updates.

    Parameters
    ----------
    x, P
        Start: state (n,) and covariance (n, n).
    config
        Treatment of large innovations.
    """

    def __init__(self, x: Array, P: Array, config: RobustConfig | None = None) -> None:
        self._config = config or RobustConfig()
        self._filter = _filter_class()(dim_x=len(x), dim_z=1)
        self._filter.x, self._filter.P = x, P

    @property
    def x(self) -> Array:
        """State (n,); replaced, never changed in place, by predict and update."""
        state: Array = self._filter.x
        return state

    @property
    def P(self) -> Array:
        """Covariance (n, n); replaced, never changed in place."""
        covariance: Array = self._filter.P
        return covariance

    def set(self, x: Array, P: Array) -> None:
        """Take another state and covariance."""
        self._filter.x, self._filter.P = x, P

    def predict(self, x_moved: Array, F: Array, Q: Array) -> None:
        """Move the state to `x_moved`, whose Jacobian by the state is F, with process noise Q."""
        self._filter.F, self._filter.Q = F, Q
        self._filter.predict(x_moved)

    def update(
        self, z: Array, z_predicted: Array, H: Array, R: Array, residual: Residual
    ) -> tuple[float, float]:
        """Correct the state by a measurement.

        Parameters
        ----------
        z, z_predicted
            Measured, and expected from the present state, (m,).
        H
            Jacobian of the expectation by the state, (m, n).
        R
            Covariance of the measurement, (m, m).
        residual
            z - z_predicted, on the circle where it is an angle.

        Returns
        -------
        Normalised innovation squared, and the weight that the measurement got.
        """
        kalman = self._filter
        x, P = kalman.x, kalman.P
        kalman.update(z, lambda _: H, lambda _: z_predicted, R, residual=residual)
        innovation, S = kalman.y, kalman.S
        # Normalised innovation squared: chi-squared with len(z) degrees of freedom.
        nis = float(innovation @ kalman.SI @ innovation)
        weight = self._config.weight(nis, len(z))
        if weight == 1.0:
            return nis, weight
        kalman.x, kalman.P = x, P
        if weight == 0.0:
            # The covariance opens a little, so that a run of rejections is accepted in the end.
            kalman.P = P * self._config.opening
            return nis, weight
        kalman.update(
            # This R scales S by 1 / weight, hence the gain by weight.
            z,
            lambda _: H,
            lambda _: z_predicted,
            R + (1.0 / weight - 1.0) * S,
            residual=residual,
        )
        return nis, weight
