"""How many poses a search of a map begins with: it follows the area in which a robot can be."""

from __future__ import annotations

from robotctl.estimation.mcl.tuning import SearchConfig


def search_size(area_m2: float, config: SearchConfig | None = None) -> int:
    """Return how many random poses a search over an area [m2] begins with."""
    config = config or SearchConfig()
    wanted = round(config.particles_per_m2 * area_m2)
    return min(max(config.particles_min, wanted), config.particles_max)


def too_large(area_m2: float, config: SearchConfig | None = None) -> str | None:
    """Return a sentence on an area [m2] that is too large for a search; None if it is not."""
    config = config or SearchConfig()
    per_m2, most = config.particles_per_m2, config.particles_max
    if per_m2 * area_m2 <= most:
        return None
    return (
        f"the map has {area_m2:.0f} m2 where the robot can be, a search from {most} poses is "
        f"meant for {most / per_m2:.0f} m2 at most: it may miss the right place"
    )
