"""Monte Carlo localisation: a belief of weighted particles, moved by odometry, weighed by sensors.

Notes, section 4; Dellaert, Fox, Burgard, Thrun 1999. Beyond the textbook:

- While the robot is tracked, random poses, the *scouts*, are weighed by the same measurement. The
  ratio of the two evidences is Bayes' factor between "as tracked" and "carried away to anywhere";
  it is accumulated, and `fit_watch.py` compares the evidence with what it used to be.
- If one of them speaks against the belief, a search begins, as from an unknown start: random poses
  join in, and each measurement is applied in steps (`annealing.py`), so that particles are found
  where its likelihood is great instead of being drawn at random. A part of the belief stays, for
  it may have been right.
- A likelihood that is too narrow for the tracked particles is tempered (`tempering.py`).
- The estimate is the mean of the heaviest cluster, from the weights before they are resampled.
- The number of particles follows the belief (KLD sampling, `pose_bins.py`).

All randomness comes from one generator, so the same seed and inputs give the same bits.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.annealing import anneal
from robotctl.estimation.belief import Cluster, clusters
from robotctl.estimation.fit_watch import FitWatch
from robotctl.estimation.free_space import SampleFree
from robotctl.estimation.log_likelihood import LogLikelihood, evaluated
from robotctl.estimation.mcl_config import MclConfig
from robotctl.estimation.particle_motion import OdometryWay
from robotctl.estimation.particles import effective_size, posterior, resample_systematic
from robotctl.estimation.pose_bins import kld_size
from robotctl.estimation.tempering import bearable_exponent
from robotctl.model.localisation import LocalisationStatus
from robotctl.model.pose_estimate import PoseEstimate
from robotctl.model.se2 import SE2

_CLUSTERS = 8
"""Clusters kept for display."""
_KEPT = 0.1
"""Share of the old belief in a new search. With more of it a wrong place that fits so so hides the
right one, which at first has few particles."""


class MonteCarloLocaliser:
    """Finds and follows the pose of `base` in `world`; starts anywhere.

    A cycle: `move` by the odometry; `measure` for each sensor that is `due`; `estimate`.

    Parameters
    ----------
    config
        Settings.
    sample_free
        Where the robot can be.
    rng
        The only source of chance.
    """

    def __init__(
        self, config: MclConfig, sample_free: SampleFree, rng: np.random.Generator
    ) -> None:
        self.config = config
        self._sample_free = sample_free
        self._rng = rng
        self._way = OdometryWay(config.motion)
        self.start_anywhere()

    def start_anywhere(self) -> None:
        """Forget all: the robot may be in any free place, with any heading."""
        self._searching = True
        self._begin(self._sample_free(self._rng, self.config.max_particles))

    def start_at(self, pose: SE2, sigma_m: float, sigma_rad: float) -> None:
        """Believe in a pose, with standard deviations of x and y [m] and of the heading [rad].

        The robot is localised at once, if these are as small as those of a localised robot.

        Raises
        ------
        ValueError
            If a standard deviation is negative or not finite.
        """
        if not (0.0 <= sigma_m < math.inf and 0.0 <= sigma_rad < math.inf):
            raise ValueError(f"sigma_m {sigma_m} and sigma_rad {sigma_rad} must be finite, >= 0")
        off = self._rng.standard_normal((self.config.max_particles, 3))
        off *= (sigma_m, sigma_m, sigma_rad)
        off += (pose.x_m, pose.y_m, pose.theta_rad)
        off[:, 2] -= math.tau * np.round(off[:, 2] / math.tau)
        self._searching = False
        self._begin(off)
        if sigma_m <= self.config.localised_m and sigma_rad <= self.config.localised_rad:
            self._agreed = self.config.localised_updates

    def _begin(self, poses: NDArray[np.float64]) -> None:
        self._poses = poses
        self._weights = np.full(len(poses), 1.0 / len(poses))
        self._heard: set[str] = set()
        """Sensors that have weighed the belief on this piece of way."""
        self._way.reset()
        self._lost = False
        self._agreed = 0
        self._elsewhere = -math.inf
        self._watches: dict[str, FitWatch] = {}
        self._clusters = clusters(poses, self._weights, self.config.bins, _CLUSTERS)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Particles at the time of the last measurement, (n, 3) [m, m, rad]; not to be changed."""
        return self._poses

    @property
    def weights(self) -> NDArray[np.float64]:
        """Their weights, (n,), of sum 1; not to be changed."""
        return self._weights

    def due(self, sensor: str = "") -> bool:
        """Whether a measurement of a sensor says something new.

        It does once on each piece of way: what a robot that stands still sees again is nothing new.
        """
        return self._has_moved or sensor not in self._heard

    @property
    def _has_moved(self) -> bool:
        """Whether a new piece of way has begun since the last measurement."""
        return (
            self._way.distance_m >= self.config.update_min_m
            or self._way.angle_rad >= self.config.update_min_rad
        )

    def move(self, delta: SE2) -> None:
        """Take in a motion of `base`, in `base` before it, as odometry gives it."""
        self._way.add(delta)

    @property
    def clusters(self) -> list[Cluster]:
        """The heaviest parts of the belief at the time of the last measurement, heaviest first."""
        return self._clusters

    @property
    def status(self) -> LocalisationStatus:
        """How far the estimate may be trusted."""
        if self._lost:
            return LocalisationStatus.LOST
        if self._agreed >= self.config.localised_updates:
            return LocalisationStatus.LOCALISED
        return LocalisationStatus.SEARCHING

    def measure(self, log_likelihood: LogLikelihood, sensor: str = "") -> None:
        """Weigh the belief by a measurement, made now.

        Parameters
        ----------
        log_likelihood
            What it says of poses.
        sensor
            Name of the sensor: how well its measurements fit is learnt for each.

        Raises
        ------
        ValueError
            If the function gives a nan or +inf, or not one number for each pose.
        """
        if self._has_moved:
            self._heard.clear()
        self._heard.add(sensor)
        self._advance()
        self._lost = False
        if self._searching:
            self._add_strangers()
            self._search(log_likelihood)
        else:
            self._track(log_likelihood, sensor)
        self._clusters = clusters(self._poses, self._weights, self.config.bins, _CLUSTERS)
        self._agreed = self._agreed + 1 if self._is_compact() and not self._lost else 0
        if self.status is LocalisationStatus.LOCALISED:
            self._searching = False

    def _is_compact(self) -> bool:
        best, config = self._clusters[0], self.config
        return (
            best.weight >= config.localised_weight
            and best.sigma_m <= config.localised_m
            and best.sigma_rad <= config.localised_rad
        )

    def estimate(self, stamp_ns: int) -> PoseEstimate:
        """Return what is believed now, moved on by the odometry since the last measurement.

        A robot that was localised is no more where the odometry alone has made it uncertain.
        """
        best, status = self._clusters[0], self.status
        faded = Cluster(best.weight, *self._way.end(best.mean, best.covariance))
        if status is LocalisationStatus.LOCALISED and faded.sigma_m > self.config.localised_m:
            status = LocalisationStatus.SEARCHING
        return PoseEstimate(stamp_ns, faded.mean, faded.covariance, status)

    def _advance(self) -> None:
        """Resample where the belief calls for it, then move all particles by the odometry."""
        uneven = effective_size(self._weights) < self.config.resample_below * len(self._weights)
        if uneven or self._searching:
            self._resample(self._wanted_particles())
        self._poses = self._way.moved(self._poses, self._rng)
        self._way.reset()

    def _add_strangers(self) -> None:
        """Mix random poses into the belief."""
        share, count = self.config.strangers, self.config.max_particles
        strangers = self._sample_free(self._rng, math.ceil(share * count))
        alike = np.full(len(strangers), share / len(strangers))
        self._poses = np.concatenate([self._poses, strangers])
        self._weights = np.concatenate([(1.0 - share) * self._weights, alike])

    def _resample(self, count: int) -> None:
        chosen = resample_systematic(self._weights, count, self._rng)
        self._poses = self._poses.take(chosen, axis=0)
        self._weights = np.full(count, 1.0 / count)

    def _wanted_particles(self) -> int:
        config = self.config
        if config.min_particles == config.max_particles:
            return config.max_particles
        return kld_size(
            self._poses,
            self._weights,
            config.bins,
            config.kld_error,
            config.kld_quantile,
            config.min_particles,
            config.max_particles,
            self._rng,
        )

    def _search(self, log_likelihood: LogLikelihood) -> None:
        """Weigh a belief that is spread wide."""
        config = self.config
        found = anneal(
            self._poses, self._weights, log_likelihood, config.bins, config.search_floor, self._rng
        )
        if found is None:
            self._lost = True  # It fits nowhere, and so does not say where the robot is.
        else:
            self._poses, self._weights = found

    def _track(self, log_likelihood: LogLikelihood, sensor: str) -> None:
        """Weigh a compact belief, and ask whether the robot may be elsewhere."""
        config = self.config
        logs = evaluated(log_likelihood, self._poses)
        scouts = self._sample_free(self._rng, math.ceil(config.scouts * len(self._poses)))
        scout_logs = evaluated(log_likelihood, scouts)
        if max(logs.max(), scout_logs.max()) == -math.inf:
            self._lost = True
            return
        weights, evidence = posterior(self._weights, logs)
        _, elsewhere = posterior(np.full(len(scouts), 1.0 / len(scouts)), scout_logs)
        self._elsewhere = max(self._elsewhere, math.log(config.carried_away))
        self._elsewhere += elsewhere - evidence
        fits = not self._watches.setdefault(sensor, FitWatch()).is_bad(evidence, elsewhere)
        if self._elsewhere > 0.0 or not fits:
            self._set_out()
            self._search(log_likelihood)
            self._lost = True
            return
        least = config.n_eff_floor * len(logs)
        if effective_size(weights) < least:
            exponent = bearable_exponent(self._weights, logs, least)
            weights, _ = posterior(self._weights, exponent * logs)
        self._weights = weights

    def _set_out(self) -> None:
        """Begin a search: a tenth of the belief stays, the rest is that the robot is anywhere."""
        count = self.config.max_particles
        self._resample(count)
        anywhere = self._sample_free(self._rng, round((1.0 - _KEPT) * count))
        self._poses[self._rng.permutation(count)[: len(anywhere)]] = anywhere
        self._searching = True
        self._elsewhere = -math.inf
        for watch in self._watches.values():
            watch.forgive()
