"""Settings of Monte Carlo localisation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from robotctl.estimation.mcl.particle_motion import ParticleMotionConfig
from robotctl.estimation.mcl.pose_bins import BinSize
from robotctl.estimation.mcl.tuning import MclTuning


@dataclass(frozen=True, slots=True)
class MclConfig(MclTuning):
    """Settings of the localiser: those of a robot's file, number of particles, and motion.

    Parameters
    ----------
    min_particles, max_particles
        Bounds of the number of particles; equal: it is fixed.
    search_poses
        Random poses that a search begins with, >= `max_particles`; None: as many.
    motion
        Noise of the odometry.
    bins
        For the number of particles, for clusters, and for how far a search tries around.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    min_particles: int = 1000
    max_particles: int = 20_000
    search_poses: int | None = None
    motion: ParticleMotionConfig = field(default_factory=ParticleMotionConfig)
    bins: BinSize = field(default_factory=BinSize)

    def __post_init__(self) -> None:
        MclTuning.__post_init__(self)
        if not 1 <= self.min_particles <= self.max_particles:
            raise ValueError(
                f"min_particles {self.min_particles} and max_particles {self.max_particles} must "
                "be 1 <= min <= max"
            )
        if self.poses_of_search < self.max_particles:
            raise ValueError(
                f"search_poses must be >= max_particles {self.max_particles}, found "
                f"{self.search_poses}"
            )

    @classmethod
    def tuned(cls, tuning: MclTuning) -> MclConfig:
        """Return the settings with those of a robot's file."""
        return cls(**{each.name: getattr(tuning, each.name) for each in fields(tuning)})

    @property
    def poses_of_search(self) -> int:
        """Random poses that a search begins with."""
        return self.max_particles if self.search_poses is None else self.search_poses

    @property
    def particles_of_search(self) -> int:
        """Particles of a search at most."""
        if self.search_poses is None:
            return self.max_particles
        return max(self.max_particles, self.search.particles_min)
