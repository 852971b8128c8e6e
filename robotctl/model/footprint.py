"""The outline of a robot on the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

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
        if not min(turns) >= 0.0:
            raise ValueError("the outline must be convex and counter-clockwise")

    def sides(self) -> list[tuple[Point, Point]]:
        """Return the sides, from corner to corner."""
        return list(zip(self.corners, self.corners[1:] + self.corners[:1], strict=True))

    @property
    def inscribed_m(self) -> float:
        """Radius of the largest circle about `base` inside of the outline [m]."""
        distances = [
            (ax * by - ay * bx) / math.dist((ax, ay), (bx, by))
            for (ax, ay), (bx, by) in self.sides()
        ]
        return min(distances, default=0.0)

    @property
    def circumscribed_m(self) -> float:
        """Radius of the circle about `base` that holds the outline [m]."""
        return max((math.hypot(*corner) for corner in self.corners), default=0.0)

    def discs(self) -> NDArray[np.float64]:
        """Return circles that cover the body, in a row along its longer side, (n, 3): x, y, r."""
        if not self.corners:
            return np.zeros((1, 3))
        low, high = np.min(self.corners, axis=0), np.max(self.corners, axis=0)
        sides = high - low
        longer = int(np.argmax(sides))
        count = math.ceil(2.0 * sides[longer] / sides[1 - longer])
        discs = np.empty((count, 3))
        discs[:, :2] = 0.5 * (low + high)
        discs[:, longer] = low[longer] + sides[longer] * (np.arange(count) + 0.5) / count
        discs[:, 2] = 0.5 * math.hypot(sides[longer] / count, sides[1 - longer])
        return discs

    def samples(self, spacing_m: float) -> NDArray[np.float64]:
        """Return points of the body, outline included, at most `spacing_m` apart, (n, 2) [m]."""
        if not self.corners:
            return np.zeros((1, 2))
        points = []
        shrink = np.linspace(1.0, 0.0, max(1, math.ceil(self.circumscribed_m / spacing_m)) + 1)
        for a, b in self.sides():
            along = np.linspace(0.0, 1.0, max(1, math.ceil(math.dist(a, b) / spacing_m)) + 1)
            points.append(np.array(a) + along[:-1, np.newaxis] * (np.array(b) - np.array(a)))
        outline = np.concatenate(points)
        return np.unique(np.concatenate([outline * s for s in shrink]).round(9), axis=0)
