"""How many particles a search of a map begins with: it follows the area in which a robot can be."""

from __future__ import annotations

from typing import Final

_FOR_A_M2: Final = 50
"""In a warehouse of 1280 m2 16 in each m2 lost the right place in 2 of 10 searches; 50 in none."""
_LEAST: Final = 20_000
_MOST: Final = 200_000
"""The first measurement of such a search takes about 2 s and 100 MB; later ones far less."""


def search_size(area_m2: float) -> int:
    """Return how many particles a search over an area takes [m2]."""
    return min(max(_LEAST, round(_FOR_A_M2 * area_m2)), _MOST)


def too_large(area_m2: float) -> str | None:
    """Return a sentence on an area [m2] that is too large for a search; None if it is not."""
    if _FOR_A_M2 * area_m2 <= _MOST:
        return None
    return (
        f"the map has {area_m2:.0f} m2 where the robot can be, a search with {_MOST} particles is "
        f"meant for {_MOST / _FOR_A_M2:.0f} m2 at most: it may miss the right place"
    )
