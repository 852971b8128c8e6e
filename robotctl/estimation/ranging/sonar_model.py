"""How likely the ranges of a ring of sonars are at a pose, on walls or on an occupancy grid.

What a sonar should measure, m, comes from `wall_echoes.py` or `grid_echoes.py`; inf if nothing
in range sends an echo. Then

- a range z has the density hit N(z; m, sigma(m)^2) + random / max_range: a robust likelihood,
  with K the random part. The Gaussian keeps its factor 1 / sigma, since
  sigma grows with the range and so differs from pose to pose;
- a range where none was expected has random / max_range: cross-talk, or something the map has not;
- no echo where one was expected has the probability none: soft, slanted or uneven surfaces;
- no echo where none was expected has hit + none.

Each of these is a likelihood of sum 1, so ranges and missing echoes weigh against each other as
they should. Sonars are multiplied, and the product is tempered as in `likelihood_field.py`: walls
that the map has wrong mislead several sonars at once.

Somebody who stands before a sonar gives an echo that is nearer than the map allows. Such a one says
little of the place, and nothing against it: that is what can be forgiven (`log_likelihood.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.grid_echoes import GridEchoes
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.sonar_cones import Echoes, SonarCones
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.estimation.ranging.wall_echoes import WallEchoes
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.sensors.sonar_mounts import mount_rows
from robotctl.model.wall_map import WallMap

_HIDDEN_SIGMAS: Final = 3.0
"""Standard deviations before the map's echo from which on something hides that."""
_MOST_HIDDEN: Final = 2
"""Maximum number of echoes of one instant that are forgiven: more speak of another place."""
_HIDDEN_LIKELIHOOD: Final = 0.5
"""Least likelihood of such an echo where people are forgiven, as a share of a perfect one's."""


def echoes_in(room: WallMap | GridMap, cones: SonarCones) -> Echoes:
    """Return the echoes of sonars in a room: exact on walls, by a fan of rays on cells."""
    return WallEchoes(room, cones) if isinstance(room, WallMap) else GridEchoes(room, cones)


class SonarModel:
    """Log-likelihoods of the readings of a ring of sonars.

    Parameters
    ----------
    room
        Walls, or an occupancy grid.
    mounts
        Mounting of the sonars, in the order of their readings.
    config
        Their limits.
    """

    def __init__(
        self,
        room: WallMap | GridMap,
        mounts: Sequence[SonarMount],
        config: SonarModelConfig | None = None,
    ) -> None:
        self.config = config or SonarModelConfig()
        cones = SonarCones(
            mount_rows(mounts),
            math.radians(self.config.beam_deg),
            math.radians(self.config.max_incidence_deg),
            self.config.max_range_m,
        )
        self._echoes = echoes_in(room, cones)
        self._sonars = len(cones.mounts)

    def measurement(self, ranges_m: NDArray[np.float64]) -> LogLikelihood:
        """Return the function from poses to the log-likelihood of readings.

        It is about 0 if all readings are as expected, however many sonars heard an echo.
        """
        return _ReadingsLikelihood(self, ranges_m)

    def log_likelihood(
        self, poses: NDArray[np.float64], ranges_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the log-likelihood of readings of one instant at each pose.

        Parameters
        ----------
        poses
            Poses of `base` in `world`, (n, 3) [m, m, rad].
        ranges_m
            One reading for each sonar [m]: inf without an echo, nan if there is no reading.

        Returns
        -------
        NDArray
            (n,); 0 if no sonar has a reading.

        Raises
        ------
        ValueError
            If there is not one reading for each sonar.
        """
        if ranges_m.shape != (self._sonars,):
            raise ValueError(
                f"ranges_m must have one reading for each of {self._sonars} sonars, "
                f"found {ranges_m.shape}"
            )
        return self._summed(self._log_densities(poses, ranges_m))

    def _log_densities(
        self, poses: NDArray[np.float64], ranges_m: NDArray[np.float64], hidden: float = 0.0
    ) -> NDArray[np.float64]:
        """Return log p of each reading that there is at each pose, (n, k).

        Of those that are nearer than the map allows, `_MOST_HIDDEN` at each pose have the share
        `hidden` of a perfect one's at least.
        """
        present = np.flatnonzero(~np.isnan(ranges_m))
        if len(present) == 0:
            return np.zeros((len(poses), 0))
        measured = ranges_m[present]
        expected = self._echoes.ranges(poses, present)
        logs = self._log_density(expected, measured)
        if hidden > 0.0:
            sigma = self.config.sigma_m + self.config.sigma_per_m * measured
            is_hidden = measured + _HIDDEN_SIGMAS * sigma < expected
            least = math.log(hidden) + self._perfect(measured)
            gains = np.where(is_hidden, np.maximum(least - logs, 0.0), 0.0)
            np.put_along_axis(gains, np.argsort(-gains, axis=1)[:, _MOST_HIDDEN:], 0.0, axis=1)
            logs = logs + gains
        return logs

    def _perfect(self, measured: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return log p of readings (k,) that are exactly as expected, (k,)."""
        expected = np.where(measured >= self.config.max_range_m, np.inf, measured)
        logs: NDArray[np.float64] = self._log_density(expected[np.newaxis], measured)[0]
        return logs

    def _summed(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the tempered sum of the log-likelihoods of readings, (..., k), (...)."""
        alpha = min(1.0, self.config.independent_readings / max(logs.shape[-1], 1))
        result: NDArray[np.float64] = alpha * logs.sum(axis=-1)
        return result

    def _log_density(
        self, expected: NDArray[np.float64], measured: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return log p(z | m) of m (n, k) and z (k,), (n, k)."""
        config = self.config
        hit = 1.0 - config.random - config.none
        nothing = np.isinf(expected)
        m = np.where(nothing, 0.0, expected)
        sigma = config.sigma_m + config.sigma_per_m * m
        none = measured >= config.max_range_m
        off = (np.where(none, 0.0, measured) - m) / sigma
        density = hit / (math.sqrt(math.tau) * sigma) * np.exp(-0.5 * off * off)
        density[nothing] = 0.0
        density += config.random / config.max_range_m
        return np.log(np.where(none, np.where(nothing, hit + config.none, config.none), density))


class _ReadingsLikelihood:
    """Log-likelihood of the readings of one instant: `Forgiving`."""

    def __init__(self, model: SonarModel, ranges_m: NDArray[np.float64]) -> None:
        self._model, self._ranges_m = model, ranges_m
        self._perfect = float(model._summed(model._perfect(ranges_m[~np.isnan(ranges_m)])))

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._model.log_likelihood(poses, self._ranges_m) - self._perfect

    def forgiven(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        logs = self._model._log_densities(poses, self._ranges_m, _HIDDEN_LIKELIHOOD)
        return self._model._summed(logs) - self._perfect
