"""A set of weighted particles: moved by odometry, weighted by measurements, resampled.

A belief that is spread over the map is searched: random poses are injected, and each
measurement is applied in steps (`annealing.py`), so that particles are found where its likelihood
is great instead of being drawn at random. A compact one is tracked: a likelihood that is too
narrow for its particles is tempered (`tempering.py`), and their number follows the belief (KLD
sampling, `pose_bins.py`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.annealing import anneal
from robotctl.estimation.mcl.belief import Cluster, clusters
from robotctl.estimation.mcl.coarse_to_fine import best_anywhere
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import SampleFree
from robotctl.estimation.mcl.particle_motion import OdometrySegment
from robotctl.estimation.mcl.particles import effective_size, posterior, resample_systematic
from robotctl.estimation.mcl.pose_bins import kld_size
from robotctl.estimation.mcl.sliced import Sliced, evaluated_in_slices
from robotctl.estimation.mcl.tempering import bearable_exponent
from robotctl.estimation.ranging.log_likelihood import LogLikelihood

_CLUSTERS = 8
"""Clusters kept for display."""


class ParticleBelief:
    """Belief of the robot's pose, as particles.

    Parameters
    ----------
    config
        Settings.
    poses
        Particles at the start, (n, 3) [m, m, rad].
    searching
        Whether they are spread over the map.
    is_uniform
        Whether they are random poses, which stand for all that a search begins with.

    Attributes
    ----------
    config
        Settings.
    poses, weights
        Particles, (n, 3), and their weights, (n,), of sum 1; not to be changed.
    searching
        Whether the belief is searched, or tracked; for the owner to change.
    clusters
        The heaviest parts at the time of the last measurement, heaviest first.
    agreed
        Consecutive measurements that left the belief compact.
    """

    def __init__(
        self,
        config: MclConfig,
        poses: NDArray[np.float64],
        *,
        searching: bool,
        is_uniform: bool = False,
    ) -> None:
        self.config = config
        self.poses = poses
        self.weights = np.full(len(poses), 1.0 / len(poses))
        self.searching = searching
        self.agreed = 0
        self._is_uniform = is_uniform
        self.clusters = self._found_clusters()

    @property
    def best(self) -> Cluster:
        """The heaviest cluster."""
        return self.clusters[0]

    @property
    def is_sure(self) -> bool:
        """Whether it has been compact for long enough."""
        return self.agreed >= self.config.localised_updates

    def advance(self, way: OdometrySegment, rng: np.random.Generator) -> None:
        """Resample where the belief calls for it, then move all particles by the odometry."""
        # Resampling after every measurement would lose particles to chance; while the weights are
        # nearly equal it gains nothing.
        uneven = effective_size(self.weights) < self.config.resample_below * len(self.weights)
        if uneven or self.searching:
            self._resample(self._wanted_particles(rng), rng)
        self.poses = way.moved(self.poses, rng)

    def search(
        self, log_likelihood: LogLikelihood, sample_free: SampleFree, rng: np.random.Generator
    ) -> Sliced[bool]:
        """Weigh a belief that is spread wide; return False if the measurement fits nowhere."""
        config = self.config
        poses, weights, logs = yield from self._with_random_poses(log_likelihood, sample_free, rng)
        found = yield from anneal(
            poses,
            weights,
            logs,
            log_likelihood,
            min(config.particles_of_search, len(poses)),
            config.bins,
            config.search_floor,
            rng,
        )
        self._is_uniform = False
        if found is not None:
            self.poses, self.weights = found
        self._judge(fits=found is not None)
        return found is not None

    def track(self, logs: NDArray[np.float64]) -> float:
        """Weigh a compact belief by the log-likelihood of each particle, (n,).

        Returns
        -------
        float
            The log-evidence; -inf if the measurement is impossible for all: then it is left
            out.
        """
        weights, evidence = posterior(self.weights, logs)
        least = self.config.n_eff_floor * len(logs)
        # Few particles would carry all the weight: apply only a part of the measurement.
        if evidence > -math.inf and effective_size(weights) < least:
            exponent = bearable_exponent(self.weights, logs, least)
            weights, _ = posterior(self.weights, exponent * logs)
        self.weights = weights
        self._judge(fits=evidence > -math.inf)
        return evidence

    def _judge(self, *, fits: bool) -> None:
        """Find the clusters, and count how long the belief has been compact."""
        self.clusters = self._found_clusters()
        # A single compact measurement may be chance, so consecutive ones count.
        self.agreed = self.agreed + 1 if fits and self._is_compact() else 0

    def _found_clusters(self) -> list[Cluster]:
        return clusters(self.poses, self.weights, self.config.bins, _CLUSTERS)

    def _is_compact(self) -> bool:
        best, config = self.best, self.config
        return (
            best.weight >= config.localised_weight
            and best.sigma_m <= config.localised_m
            and best.sigma_rad <= config.localised_rad
        )

    def _with_random_poses(
        self, log_likelihood: LogLikelihood, sample_free: SampleFree, rng: np.random.Generator
    ) -> Sliced[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
        """Return poses, weights and logs of the belief and of the best of many random poses."""
        config = self.config
        if self._is_uniform:
            poses, logs = yield from best_anywhere(
                sample_free, rng, log_likelihood, config.poses_of_search, config.particles_of_search
            )
            return poses, np.full(len(poses), 1.0 / len(poses)), logs
        # All random poses together get the weight `share`, so that they do not dilute the belief.
        share = config.random_injection
        count = math.ceil(share * config.poses_of_search)
        injected, their_logs = yield from best_anywhere(
            sample_free, rng, log_likelihood, count, config.particles_of_search
        )
        logs = yield from evaluated_in_slices(log_likelihood, self.poses)
        alike = np.full(len(injected), share / count)
        weights = np.concatenate([(1.0 - share) * self.weights, alike])
        return (
            np.concatenate([self.poses, injected]),
            weights / weights.sum(),
            np.concatenate([logs, their_logs]),
        )

    def _resample(self, count: int, rng: np.random.Generator) -> None:
        chosen = resample_systematic(self.weights, count, rng)
        self.poses = self.poses.take(chosen, axis=0)
        self.weights = np.full(count, 1.0 / count)

    def _wanted_particles(self, rng: np.random.Generator) -> int:
        config = self.config
        most = config.particles_of_search if self.searching else config.max_particles
        # A fixed number: KLD sampling has nothing to choose.
        if config.min_particles == most:
            return most
        return kld_size(
            self.poses,
            self.weights,
            config.bins,
            config.kld_error,
            config.kld_quantile,
            config.min_particles,
            most,
            rng,
        )
