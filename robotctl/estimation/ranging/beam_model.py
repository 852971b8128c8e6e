"""The beam model: how likely the range of each beam is, given how far it should go on the map.

A range is a hit, short, missing or random, by the mixture of `range_mixture.py`. The offset of a
hit is how deep in its cell a surface lies, on the average: rays are cast to the edge of the cell.
Beams are multiplied and tempered as in `likelihood_field.py`. Unlike the field this model knows
that beams do not go through walls, at the price of casting them.

The default mixture is near what three lidar logs teach at their reference poses (`python -m
benchmarks sensors`: hit 0.84 to 0.93, short 0.01 to 0.02, none 0.01 to 0.03, random 0.06 to 0.13,
offset 0.05 to 0.07 m), but for sigma: there it is 0.04 to 0.07 m; the wider one forgives particles
beside the truth. Rays pass through unknown cells: if those stopped them, expected ranges would end
at every gap of a map, and robots were lost on two of the three logs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.beam_selection import evenly_chosen, judges, tempering
from robotctl.estimation.ranging.likelihood_config import BeamSkipping
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.estimation.ranging.range_mixture import BeamMixture, log_density
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan


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
