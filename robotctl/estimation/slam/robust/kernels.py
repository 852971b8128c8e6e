"""Robust kernels: what a factor costs, and how much it weighs, where it does not fit.

With s = r^T Omega r and the scale c^2, beyond which a factor counts as wrong. Cost rho(s) is s for
small s; the weight is its derivative, by which iterated least squares minimise the sum of costs.
Zhang, Parameter estimation techniques, Image and Vision Computing 15 (1997); dynamic covariance
scaling: Agarwal et al., ICRA 2013.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import Floats


def _huber_cost(s: Floats, c2: float) -> Floats:
    return np.where(s <= c2, s, 2.0 * np.sqrt(c2 * s) - c2)


def _huber_weight(s: Floats, c2: float) -> Floats:
    result: Floats = np.sqrt(c2 / np.maximum(s, c2))
    return result


def _cauchy_cost(s: Floats, c2: float) -> Floats:
    result: Floats = c2 * np.log1p(s / c2)
    return result


def _cauchy_weight(s: Floats, c2: float) -> Floats:
    return 1.0 / (1.0 + s / c2)


def _geman_mcclure_cost(s: Floats, c2: float) -> Floats:
    return s * c2 / (c2 + s)


def _geman_mcclure_weight(s: Floats, c2: float) -> Floats:
    result: Floats = (c2 / (c2 + s)) ** 2
    return result


def _dcs_cost(s: Floats, c2: float) -> Floats:
    return np.where(s <= c2, s, c2 * (3.0 * s - c2) / (s + c2))


def _dcs_weight(s: Floats, c2: float) -> Floats:
    result: Floats = np.minimum(1.0, 2.0 * c2 / (c2 + s)) ** 2
    return result


def _truncated_cost(s: Floats, c2: float) -> Floats:
    return np.minimum(s, c2)


def _truncated_weight(s: Floats, c2: float) -> Floats:
    return (s < c2).astype(float)


KERNELS: Final[dict[str, RobustKernel]] = {
    "huber": RobustKernel(_huber_cost, _huber_weight),
    "cauchy": RobustKernel(_cauchy_cost, _cauchy_weight),
    "geman-mcclure": RobustKernel(_geman_mcclure_cost, _geman_mcclure_weight),
    "dcs": RobustKernel(_dcs_cost, _dcs_weight),
    "gnc": RobustKernel(_truncated_cost, _truncated_weight),
    "consistent": RobustKernel(_truncated_cost, _truncated_weight),
}
"""Kernels by name. Truncated least squares get nowhere alone: `gnc` is for graduated non-convexity,
`consistent` for the closures that `ConsistentClosures` leaves on."""
