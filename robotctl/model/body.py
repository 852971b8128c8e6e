"""The robot's body, as its file tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue
from robotctl.model.footprint import Footprint, Point

FARTHEST_M: Final = 10.0
"""Bound of the distance of a corner from `base`; beyond, a number is a slip [m]."""
OUTSIDE_M: Final = 0.01
"""A sensor may stand out by this [m]."""


@dataclass(frozen=True, slots=True)
class BodyConfig:
    """The outline of all that moves with the robot.

    Parameters
    ----------
    outline
        Corners of a convex outline around `base`, in order, either way round [m]. Without any, the
        body is a rectangle around nose and sonars, of `nose_m` and `half_width_m` of
        `[navigation.guard]`.

    Raises
    ------
    InvalidValue
        If the outline is none, not convex, or `base` outside of it.
    """

    outline: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        """Check the outline."""
        if not all(math.hypot(*corner) <= FARTHEST_M for corner in self.outline):
            problem = f"a corner farther than {FARTHEST_M:g} m from base, or no number"
            raise InvalidValue("outline", problem, self.outline)
        try:
            Footprint(_to_the_left(self.outline))
        except ValueError as error:
            raise InvalidValue("outline", str(error), self.outline) from error

    @property
    def footprint(self) -> Footprint | None:
        """The outline; None if there is none."""
        return Footprint(_to_the_left(self.outline)) if self.outline else None


def _to_the_left(corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """Return the corners of an outline counter-clockwise."""
    following = corners[1:] + corners[:1]
    area = sum(ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True))
    return corners if area >= 0.0 else corners[::-1]
