"""The fence of a robot: shapes of `world` that it stays within, or keeps out of."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from robotctl.model.polygons import surrounds

Point: TypeAlias = tuple[float, float]


class FencePolygon(NamedTuple):
    """A polygon."""

    corners: tuple[Point, ...]
    """Corners, at least three, in either order [m]."""
    keeps_in: bool
    """Whether the robot stays inside, else outside."""

    def surrounds(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is inside."""
        return surrounds(self.corners, (x_m, y_m))


class FenceCircle(NamedTuple):
    """A circle."""

    x_m: float
    y_m: float
    radius_m: float
    """Radius, > 0 [m]."""
    keeps_in: bool
    """Whether the robot stays inside, else outside."""

    def surrounds(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is inside."""
        return math.hypot(x_m - self.x_m, y_m - self.y_m) < self.radius_m


class Fence(NamedTuple):
    """All shapes, which hold together; none: no fence."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is no shape."""
        return not self.polygons and not self.circles

    def allows(self, x_m: float, y_m: float) -> bool:
        """Return whether the robot may be at a point of `world` [m]."""
        shapes: list[FencePolygon | FenceCircle] = [*self.polygons, *self.circles]
        return all(each.surrounds(x_m, y_m) == each.keeps_in for each in shapes)
