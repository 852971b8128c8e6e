"""How much of a likelihood a particle set can bear.

Where a likelihood is far narrower than the particles' spacing, the few that happen to lie best take
all the weight, right or wrong, and the others die. Raised to a power below 1 the likelihood is
wide enough for the particles that there are; later measurements bring what is still missing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

_HALVINGS = 12
"""Halvings of the exponent's interval: it is good to 1/4096."""
_NEAR = 1.05
"""Tolerance of the effective size above the target."""


def bearable_exponent(
    weights: NDArray[np.float64], log_likelihoods: NDArray[np.float64], n_eff_min: float
) -> float:
    """Return the greatest exponent in (0, 1] that keeps the effective sample size.

    Found by bisection, until the size is at most 5 % greater or the exponent known to within
    1 / 4096; so it is never 0.

    Parameters
    ----------
    weights
        (n,), not negative.
    log_likelihoods
        (n,), the greatest finite.
    n_eff_min
        Target effective size of the weights w L^exponent; if the weights alone have less, the
        exponent is the least.
    """
    return float(_exponent(weights, log_likelihoods - log_likelihoods.max(), n_eff_min))


@compiled
def _size(weights: NDArray[np.float64], logs: NDArray[np.float64], exponent: float) -> float:
    """Return (sum v)^2 / sum v^2 of v = w L^exponent."""
    first, second = 0.0, 0.0
    for i in range(len(weights)):
        v = weights[i] * math.exp(exponent * logs[i])
        first += v
        second += v * v
    return first * first / second if second > 0.0 else 0.0


@compiled
def _exponent(weights: NDArray[np.float64], logs: NDArray[np.float64], least: float) -> float:
    if _size(weights, logs, 1.0) >= least:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        # Bisection: the effective size falls as the exponent grows.
        middle = 0.5 * (low + high)
        size = _size(weights, logs, middle)
        if size >= least:
            low = middle
            if size <= _NEAR * least:
                break
        else:
            high = middle
    # At least some of the measurement, or the search would stand still.
    return low if low > 0.0 else high
