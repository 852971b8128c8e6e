"""A zone of the world, as a robot's or a mission's file has it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from robotctl.errors import InvalidValue
from robotctl.model.polygons import meet, sides_of, surrounds

Point: TypeAlias = tuple[float, float]

FASTEST_M_S = 100.0
MOST_CORNERS = 1000
"""Upper bounds of a speed limit [m/s] and of the corners of a zone."""


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon in `world` with its own speed limit.

    Parameters
    ----------
    name
        For people.
    corners
        In either order [m], 3 to 1000.
    speed_m_s
        The largest speed inside [m/s], 0 to 100; 0: the robot keeps out.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    name: str
    corners: tuple[Point, ...]
    speed_m_s: float = 0.0

    def __post_init__(self) -> None:
        if not 3 <= len(self.corners) <= MOST_CORNERS:
            raise InvalidValue(
                "corners", f"{len(self.corners)} found, 3 to {MOST_CORNERS} allowed", self.corners
            )
        if not all(math.isfinite(x_m) and math.isfinite(y_m) for x_m, y_m in self.corners):
            raise InvalidValue("corners", f"must be finite, found {self.corners}", self.corners)
        if not 0.0 <= self.speed_m_s <= FASTEST_M_S:
            raise InvalidValue(
                "speed_m_s",
                f"{self.speed_m_s} found, 0 to {FASTEST_M_S:g} allowed",
                self.speed_m_s,
            )

    def contains(self, point: Point) -> bool:
        """Return whether a point lies inside."""
        return surrounds(self.corners, point)

    def is_entered(self, begin: Point, end: Point) -> bool:
        """Return whether a straight way to a point leads into the zone, or touches its edge."""
        return self.contains(end) or any(
            meet(side, (begin, end)) for side in sides_of(self.corners)
        )
