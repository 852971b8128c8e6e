"""The fence of a robot: shapes of `world` that it stays within, or keeps out of."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

Point: TypeAlias = tuple[float, float]


class FencePolygon(NamedTuple):
    """A polygon; a point is inside if a line from it crosses the sides an odd number of times."""

    corners: tuple[Point, ...]
    """Three at least, in either order [m]."""
    keeps_in: bool
    """Whether the robot stays within it, or else keeps out."""


class FenceCircle(NamedTuple):
    """A circle."""

    x_m: float
    y_m: float
    radius_m: float
    """> 0 [m]."""
    keeps_in: bool
    """Whether the robot stays within it, or else keeps out."""


class Fence(NamedTuple):
    """All shapes, each of which counts; none: no fence."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to keep to."""
        return not self.polygons and not self.circles
