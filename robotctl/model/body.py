"""The robot's body, as its file tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue
from robotctl.model.footprint import Footprint
from robotctl.model.polygons import Polygon, area

FARTHEST_M: Final = 10.0
"""Bound of the distance of a corner from `base`; beyond, a number is a slip [m]."""
OUTSIDE_M: Final = 0.01
"""A sensor may stand out by this [m]."""


@dataclass(frozen=True, slots=True)
class BodyPart:
    """Something that moves with the robot, beside the outline or in it.

    Parameters
    ----------
    name
        How it is called.
    outline
        Corners of a simple polygon, in order, either way round [m]; it may leave `base` outside.

    Raises
    ------
    InvalidValue
        If the outline is no simple polygon.
    """

    name: str
    outline: Polygon

    def __post_init__(self) -> None:
        """Check the outline here, so that an error names this part."""
        _check_reach(self.outline)
        try:
            Footprint(_AROUND_BASE, (_to_the_left(self.outline),))
        except ValueError as error:
            raise InvalidValue("outline", str(error), self.outline) from error


@dataclass(frozen=True, slots=True)
class BodyConfig:
    """The outline of all that moves with the robot.

    Parameters
    ----------
    outline
        Corners of a simple polygon around `base`, in order, either way round [m]. Without any, the
        body is a rectangle around nose and sonars, of `nose_m` and `half_width_m` of
        `[navigation.guard]`.
    part
        What belongs to the body beside that.

    Raises
    ------
    InvalidValue
        If the outline is none, or `base` outside of it.
    """

    outline: Polygon = ()
    part: tuple[BodyPart, ...] = ()

    def __post_init__(self) -> None:
        """Check the outline."""
        _check_reach(self.outline)
        try:
            Footprint(_to_the_left(self.outline))
        except ValueError as error:
            raise InvalidValue("outline", str(error), self.outline) from error
        if self.part and not self.outline:
            rule = "missing, but needed beside parts"
            raise InvalidValue("outline", rule, self.outline)
        names = [part.name for part in self.part]
        if len(set(names)) < len(names):
            raise InvalidValue("part", f"two have the same name: {', '.join(names)}", names)

    @property
    def footprint(self) -> Footprint | None:
        """The outline with all parts; None if there is none."""
        parts = tuple(_to_the_left(part.outline) for part in self.part)
        return Footprint(_to_the_left(self.outline), parts) if self.outline else None


_AROUND_BASE: Final = ((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))


def _check_reach(corners: Polygon) -> None:
    """Raise InvalidValue for a corner that is too far away."""
    if not all(math.hypot(*corner) <= FARTHEST_M for corner in corners):
        problem = f"a corner farther than {FARTHEST_M:g} m from base, or no number"
        raise InvalidValue("outline", problem, corners)


def _to_the_left(corners: Polygon) -> Polygon:
    """Return the corners of an outline counter-clockwise."""
    return corners if area(corners) >= 0.0 else corners[::-1]
