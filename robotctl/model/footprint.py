"""The outline of a robot on the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

Point: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Footprint:
    """A convex outline in `base`, with `base` inside.

    Parameters
    ----------
    corners
        Corners, counter-clockwise [m], at least three; none: a robot without extent.

    Raises
    ------
    ValueError
        If the outline is not convex, runs clockwise, or leaves `base` outside.
    """

    corners: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        """Check the outline."""
        if not self.corners:
            return
        if len(self.corners) < 3:
            raise ValueError(f"an outline needs three corners at least, found {len(self.corners)}")
        for (ax, ay), (bx, by) in self.sides():
            if not ax * by - ay * bx > 0.0:
                raise ValueError(
                    f"base must lie to the left of the side {ax:g}, {ay:g} to {bx:g}, {by:g}"
                )
        turns = [
            (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
            for ((ax, ay), (bx, by)), (_, (cx, cy)) in zip(
                self.sides(), self.sides()[1:] + self.sides()[:1], strict=True
            )
        ]
        round_rad = sum(
            math.atan2(ax * by - ay * bx, ax * bx + ay * by) for (ax, ay), (bx, by) in self.sides()
        )
        if not min(turns) >= 0.0 or not math.isclose(
            round_rad, math.tau
        ):  # a star goes round twice
            raise ValueError("the outline must be convex and counter-clockwise")

    @classmethod
    def rectangle(cls, rear_m: float, front_m: float, half_width_m: float) -> Footprint:
        """Return a rectangle from `rear_m` < 0 to `front_m`, its sides equally far away."""
        half_m = half_width_m
        return cls(((front_m, -half_m), (front_m, half_m), (rear_m, half_m), (rear_m, -half_m)))

    def sides(self) -> list[tuple[Point, Point]]:
        """Return the sides, from corner to corner."""
        return list(zip(self.corners, self.corners[1:] + self.corners[:1], strict=True))

    def depth_m(self, x_m: float, y_m: float) -> float:
        """Return how deep a point of `base` lies below the nearest side [m]; < 0: outside."""
        return min(
            ((bx - ax) * (y_m - ay) - (by - ay) * (x_m - ax)) / math.dist((ax, ay), (bx, by))
            for (ax, ay), (bx, by) in self.sides()
        )

    @property
    def inscribed_m(self) -> float:
        """Radius of the largest circle about `base` inside of the outline [m]."""
        distances = [
            (ax * by - ay * bx) / math.dist((ax, ay), (bx, by))
            for (ax, ay), (bx, by) in self.sides()
        ]
        return min(distances, default=0.0)

    @property
    def reach_m(self) -> float:
        """Distance from `base` to the outermost corner [m]."""
        return max((math.hypot(*corner) for corner in self.corners), default=0.0)

    @property
    def rear_m(self) -> float:
        """Coordinate of the rearmost corner along the axis ahead [m], below 0."""
        return min((x for x, _ in self.corners), default=0.0)

    @property
    def front_m(self) -> float:
        """Distance of the foremost corner ahead of `base` [m]."""
        return max((x for x, _ in self.corners), default=0.0)

    @property
    def left_m(self) -> float:
        """Distance of the leftmost corner to the left of `base` [m]."""
        return max((y for _, y in self.corners), default=0.0)

    @property
    def right_m(self) -> float:
        """Distance of the rightmost corner to the right of `base` [m]."""
        return max((-y for _, y in self.corners), default=0.0)
