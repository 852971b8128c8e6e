"""The robot's body as a rectangle that encloses its true outline."""

from __future__ import annotations

import math
from typing import NamedTuple


class Rectangle(NamedTuple):
    """A body in `base` [m]; the origin is inside, so `rear_m` < 0."""

    rear_m: float
    front_m: float
    half_width_m: float

    @property
    def reach_m(self) -> float:
        """Distance from `base` to the outermost corner [m]."""
        return math.hypot(max(self.front_m, -self.rear_m), self.half_width_m)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The four corners."""
        half = self.half_width_m
        return tuple((x, y) for x in (self.rear_m, self.front_m) for y in (-half, half))
