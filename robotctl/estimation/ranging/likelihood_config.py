"""How a lidar's beams are weighed; without numpy, for all that read a robot's file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from robotctl.errors import InvalidValue

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    enabled: bool = False
    sigmas: float = 3.0
    below: float = 0.3
    at_most: float = 0.7

    def __post_init__(self) -> None:
        if not 0.0 < self.sigmas <= 4.0:
            raise InvalidValue("sigmas", f"must be in (0, 4], found {self.sigmas}", self.sigmas)
        for key in ("below", "at_most"):
            value = getattr(self, key)
            if not 0.0 < value < 1.0:
                raise InvalidValue(key, f"must be in (0, 1), found {value}", value)

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
        Of the log-likelihoods of two beams, [0, 1).
    skipping
        Of beams in a crowd.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    beams: int = 60
    sigma_m: float = 0.1
    robust_k: float = 0.05
    beam_correlation: float = 0.045
    skipping: BeamSkipping = field(default_factory=BeamSkipping)

    def __post_init__(self) -> None:
        if self.beams < 1:
            raise InvalidValue("beams", f"must be >= 1, found {self.beams}", self.beams)
        for key in ("sigma_m", "robust_k"):
            value = getattr(self, key)
            if not 0.0 < value < math.inf:
                raise InvalidValue(key, f"must be finite and > 0, found {value}", value)
        if not 0.0 <= self.beam_correlation < 1.0:
            raise InvalidValue(
                "beam_correlation",
                f"must be in [0, 1), found {self.beam_correlation}",
                self.beam_correlation,
            )
