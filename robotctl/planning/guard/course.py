"""Direction and curvature of a body's motion."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

Point: TypeAlias = tuple[float, float]
"""x, y of `base` [m]."""

LEAST_CLOSING: Final = 0.02
"""A corner that approaches a wall by less than this, per distance of `base`, moves along it; else a
robot close beside one could hardly turn away."""
_NOTHING: Final = 1e-9
"""Share of a motion that is rounding."""


class Course(NamedTuple):
    """Direction and bend of the way of `base`."""

    ahead: float
    """Share of the motion forwards; with `left` a unit vector, or both 0 on the spot."""
    left: float
    turn: float
    """Change of the heading, to the left > 0 [1/m]; 1 or -1 on the spot, 0 at rest."""

    @property
    def is_on_the_spot(self) -> bool:
        """Whether `base` stays where it is."""
        return self.ahead == self.left == 0.0

    @classmethod
    def of(cls, v: float, omega: float, vy: float) -> Course:
        """Return where a velocity of `base` leads."""
        if abs(vy) <= _NOTHING * abs(v):
            if v == 0.0:
                return cls(0.0, 0.0, math.copysign(1.0, omega) if omega else 0.0)
            return cls(math.copysign(1.0, v), 0.0, omega / abs(v))
        if abs(v) <= _NOTHING * abs(vy):
            return cls(0.0, math.copysign(1.0, vy), omega / abs(vy))
        speed = math.hypot(v, vy)
        return cls(v / speed, vy / speed, omega / speed)
