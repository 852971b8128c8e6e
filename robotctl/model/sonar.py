"""Where a sonar sits on the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SonarMount:
    """Mounting of one sonar in the `base` frame.

    Parameters
    ----------
    name
        Name of the sonar, not empty.
    x_m, y_m
        Position of its face in `base`, x forward, y left [m].
    heading_deg
        Direction of its axis, 0 forward, 90 left [deg].

    Raises
    ------
    ValueError
        On an empty name or a number that is not finite.
    """

    name: str
    x_m: float
    y_m: float
    heading_deg: float

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("name must not be empty")
        for key in ("x_m", "y_m", "heading_deg"):
            if not math.isfinite(getattr(self, key)):
                raise ValueError(f"{key} must be finite")

    @property
    def heading_rad(self) -> float:
        """Direction of the axis in `base` [rad]."""
        return math.radians(self.heading_deg)
