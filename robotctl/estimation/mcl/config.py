"""Settings of Monte Carlo localisation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robotctl.estimation.mcl.particle_motion import ParticleMotionConfig
from robotctl.estimation.mcl.pose_bins import BinSize

_POSITIVE = {
    "resample_below": 1.0,
    "n_eff_floor": 1.0,
    "kld_error": math.inf,
    "kld_quantile": math.inf,
    "uniform_probes": 1.0,
    "carried_away": 0.5,
    "search_floor": 1.0,
    "random_injection": 1.0,
    "localised_m": math.inf,
    "localised_rad": math.inf,
    "localised_weight": 1.0,
}
"""Settings that must be above 0 and below this."""


@dataclass(frozen=True, slots=True)
class MclConfig:
    """Settings of the localiser.

    Parameters
    ----------
    min_particles, max_particles
        Bounds of the number of particles; equal: it is fixed.
    search_particles
        Initial and maximum number in a search, >= `max_particles`; None: as many.
    motion
        Noise of the odometry.
    update_min_m, update_min_rad
        Measurements are used after this distance [m] or turn [rad], >= 0: others add little.
    bins
        For the number of particles, for clusters, and for how far a search tries around.
    kld_error, kld_quantile
        See `kld_bound`; > 0.
    resample_below
        Resample when the effective size falls below this share of the particles, (0, 1).
    n_eff_floor
        A tracked robot's measurements are tempered so that at least this share of the particles
        stays effective, (0, 1).
    uniform_probes
        Random poses that a tracked robot's measurements are compared with, as a share of the
        particles, (0, 1).
    carried_away
        Probability that the robot was carried away between two measurements, (0, 0.5).
    search_floor
        Share of the effective particles that stay so in each step of a search (`annealing.py`),
        (0, 1).
    random_injection
        Random poses that a search adds before each measurement, for places that it overlooked: as
        a share of the particles that it begins with, and of the belief, (0, 1).
    localised_m, localised_rad
        Greatest standard deviations of a localised robot [m], [rad], > 0.
    localised_weight
        Least share of the belief in its cluster, (0, 1).
    localised_updates
        Consecutive measurements needed, >= 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    min_particles: int = 1000
    max_particles: int = 20_000
    search_particles: int | None = None
    motion: ParticleMotionConfig = field(default_factory=ParticleMotionConfig)
    update_min_m: float = 0.1
    update_min_rad: float = 0.1
    bins: BinSize = field(default_factory=BinSize)
    kld_error: float = 0.05
    kld_quantile: float = 2.33
    resample_below: float = 0.5
    n_eff_floor: float = 0.01
    uniform_probes: float = 0.1
    carried_away: float = 1e-4
    search_floor: float = 0.3
    random_injection: float = 0.1
    localised_m: float = 0.3
    localised_rad: float = 0.2
    localised_weight: float = 0.9
    localised_updates: int = 5

    def __post_init__(self) -> None:
        if not 1 <= self.min_particles <= self.max_particles:
            raise ValueError(
                f"min_particles {self.min_particles} and max_particles {self.max_particles} must "
                "be 1 <= min <= max"
            )
        if self.most_searching < self.max_particles:
            raise ValueError(
                f"search_particles must be >= max_particles {self.max_particles}, found "
                f"{self.search_particles}"
            )
        for key, most in _POSITIVE.items():
            if not 0.0 < getattr(self, key) < most:
                raise ValueError(f"{key} must be in (0, {most}), found {getattr(self, key)}")
        for key in ("update_min_m", "update_min_rad"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")
        if self.localised_updates < 1:
            raise ValueError(f"localised_updates must be >= 1, found {self.localised_updates}")

    @property
    def most_searching(self) -> int:
        """Particles of a search at most."""
        return self.max_particles if self.search_particles is None else self.search_particles
