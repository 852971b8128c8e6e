"""The beam model: how likely the range of each beam is, given how far it should go on the map.

Four things make a range z where the map has its first obstacle at z* (Thrun, Burgard, Fox:
Probabilistic Robotics, section 6.3):

- hit: the obstacle, with Gaussian noise about z* + offset. The offset is how deep in its cell a
  surface lies, on the average: rays are cast to the edge of the cell;
- short: something in front that the map has not, people most of all: exponential, cut off at z*;
- none: no echo, the sensor's greatest range;
- random: anything, uniform.

Where the map has nothing within the greatest range, a hit is a reading without an echo. Each part
is a density or a probability of sum 1 (the Gaussian's tails below 0 and beyond the greatest range
are neglected), so the mixture is a likelihood. Beams are multiplied and tempered as in
`likelihood_field.py`. Unlike the field this model knows that beams do not go through walls, at the
price of casting them.

The default mixture is near what three lidar logs teach at their reference poses (`python -m
benchmarks sensors`: hit 0.84 to 0.93, short 0.01 to 0.02, none 0.01 to 0.03, random 0.06 to 0.13,
offset 0.05 to 0.07 m), but for sigma: there it is 0.04 to 0.07 m; the wider one forgives particles
beside the truth. Rays pass through unknown cells: if those stopped them, expected ranges would end
at every gap of a map, and robots were lost on two of the three logs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.beam_selection import evenly_chosen, judges, tempering
from robotctl.estimation.likelihood_config import BeamSkipping
from robotctl.estimation.log_likelihood import LogLikelihood
from robotctl.estimation.range_casting import RangeCaster
from robotctl.model.grid_map import GridMap
from robotctl.model.range_scan import RangeScan

_Real = TypeVar("_Real", np.float32, np.float64)

_LEAST_WEIGHT: Final = 1e-3
_LEAST_SIGMA_M: Final = 1e-3
"""No part is ever learned to be impossible, nor an obstacle to be exact."""


@dataclass(frozen=True, slots=True)
class BeamMixture:
    """Weights and shapes of the four parts.

    Parameters
    ----------
    hit, short, none, random
        Weights, > 0, of sum 1.
    sigma_m
        Standard deviation of a hit, of sensor and map together [m], > 0.
    offset_m
        Mean of a hit, from the edge of the obstacle's cell [m].
    short_per_m
        Rate of the exponential [1/m], > 0.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    hit: float = 0.85
    short: float = 0.03
    none: float = 0.02
    random: float = 0.1
    sigma_m: float = 0.1
    offset_m: float = 0.05
    short_per_m: float = 0.1

    def __post_init__(self) -> None:
        for key in (f.name for f in fields(self) if f.name != "offset_m"):
            value = getattr(self, key)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {value}")
        if not math.isfinite(self.offset_m):
            raise ValueError(f"offset_m must be finite, found {self.offset_m}")
        total = self.hit + self.short + self.none + self.random
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"hit, short, none and random must sum to 1, found {total}")


@dataclass(frozen=True, slots=True)
class BeamModelConfig:
    """How beams are weighed.

    Parameters
    ----------
    beams
        Beams taken of a scan, evenly chosen of those with a reading or without an echo, >= 1.
    mixture
        Of the four parts; `learned` finds it.
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
    mixture: BeamMixture = field(default_factory=BeamMixture)
    beam_correlation: float = 0.1
    skipping: BeamSkipping = field(default_factory=BeamSkipping)

    def __post_init__(self) -> None:
        if self.beams < 1:
            raise ValueError(f"beams must be >= 1, found {self.beams}")
        if not 0.0 <= self.beam_correlation < 1.0:
            raise ValueError(f"beam_correlation must be in [0, 1), found {self.beam_correlation}")


class BeamModel:
    """Log-likelihoods of scans on an occupancy grid, by casting rays.

    Parameters
    ----------
    grid
        The map.
    config
        How beams are weighed.
    """

    def __init__(self, grid: GridMap, config: BeamModelConfig | None = None) -> None:
        self.config = config or BeamModelConfig()
        self._caster = RangeCaster(grid)

    def measurement(self, scan: RangeScan) -> LogLikelihood:
        """Return the function from poses to the log-likelihood of a scan.

        It is about 0 where all ranges are as expected. Which beams are skipped is decided by the
        first poses that it is asked for, as in `LikelihoodField.measurement`.
        """
        perfect = self._perfect(scan)
        chosen = evenly_chosen(~np.isnan(scan.ranges_m), self.config.beams)
        alpha = tempering(len(chosen), self.config.beam_correlation)
        undecided = self.config.skipping.enabled

        def log_likelihood(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            nonlocal chosen, undecided
            if undecided:
                chosen, undecided = self._without_skipped(poses, scan, chosen), False
            return alpha * self._summed(poses, scan, chosen) - perfect

        return log_likelihood

    def _perfect(self, scan: RangeScan) -> float:
        """Return the log-likelihood of a scan where all ranges are just what is expected."""
        chosen = evenly_chosen(~np.isnan(scan.ranges_m), self.config.beams)
        measured = scan.ranges_m[chosen]
        edges = np.maximum(measured - self.config.mixture.offset_m, 0.0)
        expected = np.where(measured < scan.max_range_m, edges, np.inf)[:, np.newaxis]
        logs = log_density(self.config.mixture, expected, measured, scan.max_range_m)
        return tempering(len(chosen), self.config.beam_correlation) * float(logs.sum())

    def log_likelihood(self, poses: NDArray[np.float64], scan: RangeScan) -> NDArray[np.float64]:
        """Return the log-likelihood of a scan at each pose.

        Parameters
        ----------
        poses
            Of `base` in `world`, (n, 3) [m, m, rad].
        scan
            The measurement; beams of nan are left out.

        Returns
        -------
        NDArray
            (n,); of densities, so it may be positive. 0 if no beam has a reading.
        """
        return self.measurement(scan)(poses) + self._perfect(scan)

    def _summed(
        self, poses: NDArray[np.float64], scan: RangeScan, chosen: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return the sum of the chosen beams' logs at each pose, (n,)."""
        expected = self.expected_ranges(poses, scan, chosen)
        logs = log_density(self.config.mixture, expected, scan.ranges_m[chosen], scan.max_range_m)
        summed: NDArray[np.float64] = logs.sum(axis=0, dtype=np.float64)
        return summed

    def expected_ranges(
        self, poses: NDArray[np.float64], scan: RangeScan, chosen: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return how far the chosen beams (k,) should go from each pose, (k, n) [m], or inf."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        sensor = np.stack(
            [
                poses[:, 0] + c * scan.x_m - s * scan.y_m,
                poses[:, 1] + s * scan.x_m + c * scan.y_m,
                poses[:, 2],
            ],
            axis=1,
        )
        return self._caster.cast(sensor, scan.angles_rad[chosen], scan.max_range_m)

    def _without_skipped(
        self, poses: NDArray[np.float64], scan: RangeScan, chosen: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Return those of the chosen beams that enough poses agree with."""
        few = judges(poses)
        if few is None or len(chosen) == 0:
            return chosen
        mixture = self.config.mixture
        expected = self.expected_ranges(few, scan, chosen) + mixture.offset_m
        measured = scan.ranges_m[chosen][:, np.newaxis]
        measured = np.where(measured < scan.max_range_m, measured, np.inf)
        with np.errstate(invalid="ignore"):  # inf - inf
            near = np.abs(measured - expected) <= self.config.skipping.sigmas * mixture.sigma_m
        agrees = near | (measured == expected)
        return chosen[self.config.skipping.kept(agrees.mean(axis=1))]


def log_density(
    mixture: BeamMixture,
    expected_m: NDArray[np.float64],
    measured_m: NDArray[np.float64],
    max_range_m: float,
) -> NDArray[np.float32]:
    """Return log p(z | z*) of each beam at each pose, (k, n), in single precision.

    Parameters
    ----------
    mixture
        Weights and shapes of the parts.
    expected_m
        z*, (k, n) [m]; inf where the map has nothing in range.
    measured_m
        z, (k,) [m]; inf or at least `max_range_m` without an echo; no nan.
    max_range_m
        The sensor's greatest range [m].
    """
    seen = measured_m < max_range_m
    result = np.empty(expected_m.shape, np.float32)
    nothing = np.isinf(expected_m[~seen])
    result[~seen] = np.where(
        nothing, np.float32(math.log(mixture.none + mixture.hit)), math.log(mixture.none)
    )
    z_star = expected_m[seen].astype(np.float32)
    z = measured_m[seen].astype(np.float32)[:, np.newaxis]
    hit, short = _densities(mixture, z_star, z, max_range_m)
    hit += short
    hit += mixture.random / max_range_m
    result[seen] = np.log(hit, out=hit)
    return result


def _densities(
    mixture: BeamMixture, z_star: NDArray[_Real], z: NDArray[_Real], max_range_m: float
) -> tuple[NDArray[_Real], NDArray[_Real]]:
    """Return the weighted densities of hit and of short at ranges z < max, in z's precision."""
    off = z_star - (z - mixture.offset_m)
    off *= math.sqrt(0.5) / mixture.sigma_m
    hit = np.exp(np.negative(np.square(off, out=off), out=off), out=off)
    hit *= mixture.hit / (math.sqrt(math.tau) * mixture.sigma_m)
    rate = mixture.short_per_m
    uncut = mixture.short * rate * np.exp(-rate * z)
    within = 1.0 - np.exp(-rate * np.minimum(z_star, max_range_m))  # numpy's expm1 is slow
    short = uncut / np.maximum(within, 1e-30)
    short *= z < z_star
    return hit, short


def learned(
    mixture: BeamMixture,
    expected_m: NDArray[np.float64],
    measured_m: NDArray[np.float64],
    max_range_m: float,
    iterations: int = 50,
) -> BeamMixture:
    """Return the mixture that fits pairs of expected and measured ranges best, by EM.

    Probabilistic Robotics, table 6.2, with the offset of a hit, and with the exponential's cut: at
    z* its mean is 1/rate - z* / (e^(rate z*) - 1).

    Parameters
    ----------
    mixture
        Where the search starts.
    expected_m, measured_m
        z* and z of many beams, (m,) [m]; inf where the map has nothing in range and without an
        echo. Pairs of nan are left out.
    max_range_m
        The sensor's greatest range [m].
    iterations
        Of expectation and maximisation.

    Raises
    ------
    ValueError
        If there is no pair.
    """
    valid = ~np.isnan(measured_m)
    z_star, z = expected_m[valid], measured_m[valid]
    if len(z) == 0:
        raise ValueError("no pair of expected and measured ranges to learn from")
    seen = z < max_range_m
    none = int(np.count_nonzero(~seen))
    none_expected = int(np.count_nonzero(np.isinf(z_star[~seen])))
    for _ in range(iterations):
        mixture = _em_step(mixture, z_star[seen], z[seen], max_range_m, none, none_expected)
    return mixture


def _em_step(
    mixture: BeamMixture,
    z_star: NDArray[np.float64],
    z: NDArray[np.float64],
    max_range_m: float,
    none: int,
    none_expected: int,
) -> BeamMixture:
    """Return the mixture after one step, from pairs with a reading and counts of those without."""
    hit, short = _densities(mixture, z_star, z, max_range_m)
    p = hit + short + mixture.random / max_range_m
    r_hit, r_short = hit / p, short / p
    hit_none = none_expected * mixture.hit / (mixture.hit + mixture.none)
    weights = np.array(
        [
            r_hit.sum() + hit_none,
            r_short.sum(),
            none - hit_none,
            len(z) - r_hit.sum() - r_short.sum(),
        ]
    )
    weights = np.maximum(weights / weights.sum(), _LEAST_WEIGHT)
    w_hit, w_short, w_none, w_random = (weights / weights.sum()).tolist()
    sigma_m, offset_m, rate = mixture.sigma_m, mixture.offset_m, mixture.short_per_m
    if r_hit.sum() > 0.0:
        off = np.where(np.isfinite(z_star), z - z_star, 0.0)
        offset_m = float(np.average(off, weights=r_hit))
        sigma_m = math.sqrt(float(np.average((off - offset_m) ** 2, weights=r_hit)))
    before = r_short > 0.0
    if before.any():
        cut = np.minimum(z_star[before], max_range_m)
        beyond = cut * np.exp(-rate * cut) / -np.expm1(-rate * cut)
        rate = 1.0 / float(np.average(z[before] + beyond, weights=r_short[before]))
    return BeamMixture(
        w_hit, w_short, w_none, w_random, max(sigma_m, _LEAST_SIGMA_M), offset_m, rate
    )
