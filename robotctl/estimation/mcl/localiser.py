"""Monte Carlo localisation: a belief of weighted particles, moved by odometry, weighed by sensors.

Dellaert, Fox, Burgard, Thrun 1999. Beyond the textbook:

- While the robot is tracked, poses drawn from all free space, the uniform probes, are weighed by
  the same measurement. The ratio of the two evidences is Bayes' factor between "as tracked" and
  "kidnapped, and anywhere now"; it is accumulated, and `likelihood_monitor.py` compares the
  evidence with what it used to be. Beams that something hides from the map say little
  (`log_likelihood.py`).
- If one of them contradicts the belief, a search starts in parallel, as from an unknown start
  (`particle_belief.py`). The belief is kept until the search result has explained the measurements
  better over some distance (`rival.py`).
- The estimate is the mean of the heaviest cluster, from the weights before they are resampled.

All randomness comes from one generator, so the same seed and inputs give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.belief import Cluster
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import SampleFree
from robotctl.estimation.mcl.likelihood_monitor import LikelihoodMonitor
from robotctl.estimation.mcl.look_alikes import look_alikes
from robotctl.estimation.mcl.misfit import Misfit
from robotctl.estimation.mcl.particle_belief import ParticleBelief
from robotctl.estimation.mcl.particle_motion import OdometrySegment
from robotctl.estimation.mcl.particles import posterior
from robotctl.estimation.mcl.remembered import Remembered
from robotctl.estimation.mcl.rival import Rival, RivalVerdict
from robotctl.estimation.mcl.sliced import Sliced, at_once, evaluated_in_slices
from robotctl.estimation.ranging.log_likelihood import Forgiving, LogLikelihood, forgiven
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2

_FORGIVEN = 4
"""Number of best poses that show what is hidden from the map."""

_UNWEIGHED = 200_000
"""Particles at most of a belief that nothing has been measured for."""


class MonteCarloLocaliser:
    """Finds and follows the pose of `base` in `world`; starts anywhere.

    A cycle: `move` by the odometry; `measure` for each sensor that is `due`; `estimate`.

    Parameters
    ----------
    config
        Settings.
    sample_free
        Draws poses where the robot can be.
    rng
        The only source of chance.
    symmetries
        Motions that carry the map nearly onto itself (`map_symmetry.py`).
    """

    def __init__(
        self,
        config: MclConfig,
        sample_free: SampleFree,
        rng: np.random.Generator,
        symmetries: Sequence[SE2] = (),
    ) -> None:
        self._symmetries = symmetries
        self.config = config
        self._sample_free = sample_free
        self._rng = rng
        self._way = OdometrySegment(config.motion)
        self.start_anywhere()

    def start_anywhere(self) -> None:
        """Forget all: the robot may be in any free place, with any heading."""
        self._begin(self._anywhere())

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
        self._begin(ParticleBelief(self.config, off, searching=False))
        if sigma_m <= self.config.localised_m and sigma_rad <= self.config.localised_rad:
            self._belief.agreed = self.config.localised_updates

    def _anywhere(self) -> ParticleBelief:
        """Return a belief that the robot is anywhere."""
        poses = self._sample_free(self._rng, min(self.config.poses_of_search, _UNWEIGHED))
        return ParticleBelief(self.config, poses, searching=True, is_uniform=True)

    def _begin(self, belief: ParticleBelief) -> None:
        self._belief = belief
        self._rival: Rival | None = None
        self._remembered = Remembered()
        """Measurements since a search began."""
        self._misfits: dict[str, Misfit] = {}
        self._heard: set[str] = set()
        """Sensors that have weighted the belief on this stretch, and"""
        self._heard_before: set[str] = set()
        """on the one before."""
        self._way.reset()
        self._lost = False
        self._was_localised = False
        """Whether the tracked place was sure once."""
        self._elsewhere = -math.inf
        self._watches: dict[str, LikelihoodMonitor] = {}

    @property
    def poses(self) -> NDArray[np.float64]:
        """Particles at the time of the last measurement, (n, 3) [m, m, rad]; not to be changed."""
        return self._belief.poses

    @property
    def weights(self) -> NDArray[np.float64]:
        """Their weights, (n,), of sum 1; not to be changed."""
        return self._belief.weights

    def due(self, sensor: str = "") -> bool:
        """Whether a measurement of a sensor adds information.

        It does once per stretch: a robot at rest sees the same again.
        """
        return self._has_moved or sensor not in self._heard

    @property
    def _has_moved(self) -> bool:
        """Whether a new stretch has begun since the last measurement."""
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
        return self._belief.clusters

    @property
    def status(self) -> LocalisationStatus:
        """Trust in the estimate."""
        if self._lost or self.fits_nowhere:
            return LocalisationStatus.LOST
        if self._is_undisputed and self._belief.is_sure:
            return LocalisationStatus.LOCALISED
        return LocalisationStatus.SEARCHING

    @property
    def is_tracked(self) -> bool:
        """Whether the robot was localised, and its place has become less sure at most.

        Sonars tell nothing along a corridor: there the belief grows as odometry errs.
        """
        best, config = self._belief.best, self.config
        if not (self._was_localised and self._is_undisputed):
            return False
        sigma_m = Cluster(best.weight, *self._way.end(best.mean, best.covariance)).sigma_m
        return best.weight >= config.localised_weight and sigma_m <= config.tracked_m

    @property
    def _is_undisputed(self) -> bool:
        """Whether nothing speaks against the tracked place."""
        is_tracking = self._rival is None and not self._belief.searching
        return is_tracking and not self._lost and not self.fits_nowhere

    @property
    def fits_nowhere(self) -> bool:
        """Whether what was seen since the place was known fits no place of the map."""
        return any(each.is_bad for each in self._misfits.values())

    def measure(self, log_likelihood: LogLikelihood, sensor: str = "") -> None:
        """Weigh the belief by a measurement, made now; see `measuring`."""
        at_once(self.measuring(log_likelihood, sensor))

    def measuring(self, log_likelihood: LogLikelihood, sensor: str = "") -> Sliced[None]:
        """Weigh the belief by a measurement, made when the first slice begins.

        Between its slices the robot may `move` and its `estimate` be asked for. It must be done
        before the next measurement.

        Parameters
        ----------
        log_likelihood
            Its log-likelihood of poses.
        sensor
            Name of the sensor: how well its measurements fit is learnt for each.

        Raises
        ------
        ValueError
            If the function gives a nan or +inf, or not one number for each pose.
        """
        if self._has_moved:
            self._heard, self._heard_before = set(), self._heard
        self._heard.add(sensor)
        distance_m, angle_rad = self._way.distance_m, self._way.angle_rad
        self._belief.advance(self._way, self._rng)
        if self._rival is not None:
            self._rival.belief.advance(self._way, self._rng)
        self._remembered.move(self._way.motion)
        self._way.reset()
        self._lost = False
        if self._belief.searching:
            fits = yield from self._belief.search(log_likelihood, self._sample_free, self._rng)
            self._lost = not fits
            self._remembered.add(log_likelihood)
            self._see_fit(log_likelihood, sensor, self._belief)
            if self._belief.is_sure and not self.fits_nowhere:
                yield from self._settle()
        else:
            yield from self._track(log_likelihood, sensor, distance_m, angle_rad)
        is_sure = self.status is LocalisationStatus.LOCALISED
        self._was_localised = is_sure or (self._was_localised and self._is_undisputed)

    def _settle(self) -> Sliced[None]:
        """Track the place that a search has found, with the others that resemble it."""
        others = yield from look_alikes(
            self._belief,
            self._remembered,
            self._sample_free,
            self.config,
            self._rng,
            self._symmetries,
        )
        self._belief.searching = False
        if others is None:
            self._end_search()
        else:
            # A place with look-alikes stays unproven until motion separates them.
            self._rival = Rival(ParticleBelief(self.config, others, searching=True))

    def _end_search(self) -> None:
        """Know the place."""
        self._rival = None
        self._remembered.clear()
        self._misfits.clear()

    def _see_fit(
        self, log_likelihood: LogLikelihood, sensor: str, *beliefs: ParticleBelief
    ) -> None:
        """Take in how well a measurement fits where it fits best."""
        if isinstance(log_likelihood, Forgiving):
            best = np.concatenate([belief.poses[_heaviest(belief)] for belief in beliefs])
            # Judged at the best pose: a scan that fits nowhere means the wrong map.
            misfit = self._misfits.setdefault(sensor, Misfit(self.config.search))
            misfit.add(float(log_likelihood.forgiven(best).max()))

    def estimate(self, stamp_ns: int) -> PoseEstimate:
        """Return the present estimate, moved by the odometry since the last measurement.

        A localised robot becomes unlocalised when odometry alone has made it uncertain.
        """
        best, status = self._belief.best, self.status
        faded = Cluster(best.weight, *self._way.end(best.mean, best.covariance))
        if status is LocalisationStatus.LOCALISED and faded.sigma_m > self.config.localised_m:
            status = LocalisationStatus.SEARCHING
        return PoseEstimate(stamp_ns, faded.mean, faded.covariance, status)

    def _track(
        self, log_likelihood: LogLikelihood, sensor: str, distance_m: float, angle_rad: float
    ) -> Sliced[None]:
        """Weigh a compact belief, and ask whether the robot may be elsewhere."""
        logs = yield from evaluated_in_slices(log_likelihood, self._belief.poses)
        uniform_probes = self._sample_free(
            self._rng, math.ceil(self.config.uniform_probes * len(logs))
        )
        probe_logs = yield from evaluated_in_slices(log_likelihood, uniform_probes)
        if max(logs.max(), probe_logs.max()) == -math.inf:
            self._lost = True
            return
        evidence = self._belief.track(logs)
        watch = self._watches.setdefault(sensor, LikelihoodMonitor(self.config.monitor))
        if watch.is_low(evidence):
            evidence += self._forgiveness(log_likelihood, self._belief, logs)
            best = np.argpartition(probe_logs, -_FORGIVEN)[-_FORGIVEN:]
            probe_logs[best] = forgiven(log_likelihood, uniform_probes[best])
        _, elsewhere = posterior(
            np.full(len(uniform_probes), 1.0 / len(uniform_probes)), probe_logs
        )
        if self._rival is not None:
            yield from self._contend(
                self._rival, log_likelihood, sensor, evidence, distance_m, angle_rad
            )
        elif self._is_doubtful(evidence, elsewhere, sensor):
            self._lost = True
            self._rival = Rival(self._anywhere())
            self._remembered.add(log_likelihood)
            yield from self._rival.belief.search(log_likelihood, self._sample_free, self._rng)

    def _forgiveness(
        self, log_likelihood: LogLikelihood, belief: ParticleBelief, logs: NDArray[np.float64]
    ) -> float:
        """Return how much better a measurement fits without what hides the map [nat]."""
        best = _heaviest(belief)
        return float(np.mean(forgiven(log_likelihood, belief.poses[best]) - logs[best]))

    def _is_doubtful(self, evidence: float, elsewhere: float, sensor: str) -> bool:
        """Whether the measurements have come to speak against the belief."""
        self._elsewhere = max(self._elsewhere, math.log(self.config.carried_away))
        self._elsewhere += elsewhere - evidence
        heard = self._watches.keys() & (self._heard | self._heard_before) - {sensor}
        others = [self._watches[each] for each in sorted(heard)]
        is_bad = self._watches[sensor].is_bad(evidence, elsewhere, others)
        return is_bad or self._elsewhere > 0.0

    def _contend(
        self,
        rival: Rival,
        log_likelihood: LogLikelihood,
        sensor: str,
        evidence: float,
        distance_m: float,
        angle_rad: float,
    ) -> Sliced[None]:
        """Compare belief and rival by a measurement; the better one stays."""
        belief = rival.belief
        logs = yield from evaluated_in_slices(log_likelihood, belief.poses)
        foretold = posterior(belief.weights, logs)[1]
        if foretold > -math.inf:
            foretold += self._forgiveness(log_likelihood, belief, logs)
        lead = foretold - evidence if foretold > -math.inf else -math.inf
        yield from belief.search(log_likelihood, self._sample_free, self._rng)
        self._remembered.add(log_likelihood)
        self._see_fit(log_likelihood, sensor, self._belief, belief)
        verdict = rival.compare(lead, distance_m, angle_rad, self._belief.best)
        if verdict is RivalVerdict.OPEN:
            return
        self._elsewhere = -math.inf
        for watch in self._watches.values():
            watch.forgive()
        if verdict is RivalVerdict.PROVEN:
            self._belief = belief
            belief.agreed = self.config.localised_updates // 2  # The rest confirms it.
        if self.fits_nowhere:
            self._belief.searching = False
            self._rival = Rival(self._anywhere())
        elif verdict is RivalVerdict.PROVEN:
            yield from self._settle()
        else:
            self._end_search()


def _heaviest(belief: ParticleBelief) -> NDArray[np.intp]:
    """Return which particles have the greatest weights."""
    heaviest: NDArray[np.intp] = np.argpartition(belief.weights, -_FORGIVEN)[-_FORGIVEN:]
    return heaviest
