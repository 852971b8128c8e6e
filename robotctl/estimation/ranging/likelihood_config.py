"""How a lidar's beams are weighed; without numpy, for all that read a robot's file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from robotctl.errors import InvalidValue

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def _check_positive(config: object, *keys: str) -> None:
    """Refuse values that are not finite and > 0."""
    for key in keys:
        value = getattr(config, key)
        if not 0.0 < value < math.inf:
            raise InvalidValue(key, f"must be finite and > 0, found {value}", value)


@dataclass(frozen=True, slots=True)
class BeamSkipping:
    """When beams are left out.

    Parameters
    ----------
    enabled
        Whether any are.
    sigmas
        Standard deviations within which a beam agrees with a pose, (0, 4].
    below
        A beam is left out if it agrees with less than this share of the poses, (0, 1).
    at_most
        If more than this share of the beams would be left out, none is, (0, 1).
    spread_max_m, spread_max_rad
        Standard deviations of the poses [m], [rad], > 0, above which no beam is left out: poses
        that spread more cannot say that it is wrong.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    enabled: bool = False
    sigmas: float = 3.0
    below: float = 0.3
    at_most: float = 0.7
    spread_max_m: float = 0.5
    spread_max_rad: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 < self.sigmas <= 4.0:
            raise InvalidValue("sigmas", f"must be in (0, 4], found {self.sigmas}", self.sigmas)
        for key in ("below", "at_most"):
            value = getattr(self, key)
            if not 0.0 < value < 1.0:
                raise InvalidValue(key, f"must be in (0, 1), found {value}", value)
        _check_positive(self, "spread_max_m", "spread_max_rad")

    def kept(self, agreeing_share: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which beams to keep, (k,), from the share of the poses that each agrees with."""
        kept = agreeing_share >= self.below
        if (~kept).sum() > self.at_most * len(kept):
            return kept | True
        return kept


@dataclass(frozen=True, slots=True)
class LikelihoodFieldConfig:
    """How beams are weighed.

    Parameters
    ----------
    beams
        Beams taken of a scan, evenly chosen of those that hit something, >= 1.
    sigma_m
        Standard deviation of the distance of an end point from its obstacle, of sensor and map
        together [m], > 0.
    robust_k
        K: likelihood of a beam that ends anywhere, against that of one on an obstacle, > 0.
    beam_correlation
        Correlation of the log-likelihoods of two beams, [0, 1).
    hidden_sigmas
        A beam is hidden from the map if it ends by more standard deviations before the map's first
        obstacle, > 0.
    hidden_likelihood
        Least likelihood of a hidden beam where people are forgiven, (0, 1].
    skipping
        When beams are left out in a crowd.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    beams: int = 60
    sigma_m: float = 0.1
    robust_k: float = 0.05
    beam_correlation: float = 0.045
    hidden_sigmas: float = 3.0
    hidden_likelihood: float = 0.5
    skipping: BeamSkipping = field(default_factory=BeamSkipping)

    def __post_init__(self) -> None:
        if self.beams < 1:
            raise InvalidValue("beams", f"must be >= 1, found {self.beams}", self.beams)
        _check_positive(self, "sigma_m", "robust_k", "hidden_sigmas")
        if not 0.0 < self.hidden_likelihood <= 1.0:
            raise InvalidValue(
                "hidden_likelihood",
                f"must be in (0, 1], found {self.hidden_likelihood}",
                self.hidden_likelihood,
            )
        if not 0.0 <= self.beam_correlation < 1.0:
            raise InvalidValue(
                "beam_correlation",
                f"must be in [0, 1), found {self.beam_correlation}",
                self.beam_correlation,
            )
