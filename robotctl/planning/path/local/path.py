"""A path: points joined by straight segments, measured by the length along it."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from robotctl.model.geometry.angles import wrap_angle

Point: TypeAlias = tuple[float, float]
"""x and y in `world` [m]."""

_ARC_STEP_RAD = math.radians(8.0)
_SAME_POINT_M = 1e-6
_TIE_M2 = 1e-9
"""On a path that leads back over itself the earlier of two equally near places counts."""


class Projection(NamedTuple):
    """The place on a path nearest to a point."""

    s_m: float
    """Length along the path up to there [m]."""
    distance_m: float
    """Distance of the point from the path [m], >= 0."""


class Path:
    """An immutable polyline of at least two different points.

    Parameters
    ----------
    points
        Points in `world` [m]; repeated ones are dropped.

    Raises
    ------
    ValueError
        With fewer than two different points or a coordinate that is not finite.
    """

    __slots__ = ("_directions", "_lengths", "_starts", "points")

    def __init__(self, points: Sequence[Point]) -> None:
        self.points = _without_repeats(points)
        if len(self.points) < 2:
            raise ValueError("a path needs at least two different points")
        pairs = list(itertools.pairwise(self.points))
        self._lengths = [math.dist(a, b) for a, b in pairs]
        self._directions = [
            ((b[0] - a[0]) / length, (b[1] - a[1]) / length)
            for (a, b), length in zip(pairs, self._lengths, strict=True)
        ]
        self._starts = [0.0, *itertools.accumulate(self._lengths)]

    @property
    def length_m(self) -> float:
        """Length of the whole path [m]."""
        return self._starts[-1]

    def vertex_s_m(self, index: int) -> float:
        """Return the length along the path up to point `index` [m]."""
        return self._starts[index]

    def segment_at(self, s_m: float) -> int:
        """Return the index of the segment at length `s_m`, clamped to the path."""
        return min(max(bisect_right(self._starts, s_m) - 1, 0), len(self._lengths) - 1)

    def point_at(self, s_m: float) -> Point:
        """Return the point at length `s_m`; beyond either end the path continues straight [m]."""
        index = self.segment_at(s_m)
        x, y = self.points[index]
        dx, dy = self._directions[index]
        along = s_m - self._starts[index]
        return x + along * dx, y + along * dy

    def turn_rad(self, vertex: int) -> float:
        """Return the change of direction at an inner point, positive to the left [rad]."""
        ax, ay = self._directions[vertex - 1]
        bx, by = self._directions[vertex]
        return math.atan2(ax * by - ay * bx, ax * bx + ay * by)

    def project(self, x_m: float, y_m: float, from_m: float, to_m: float) -> Projection:
        """Return the place nearest to (x, y) between the lengths `from_m` and `to_m` [m].

        The window keeps apart pieces of a path that pass by the same place.
        """
        best_s, best_squared = from_m, math.inf
        for index in range(self.segment_at(from_m), len(self._lengths)):
            start = self._starts[index]
            if start > to_m:
                break
            px, py = self.points[index]
            dx, dy = self._directions[index]
            along = (x_m - px) * dx + (y_m - py) * dy
            low = max(0.0, from_m - start)
            high = min(self._lengths[index], to_m - start)
            along = min(max(along, low), high)
            ex, ey = px + along * dx - x_m, py + along * dy - y_m
            squared = ex * ex + ey * ey
            if squared < best_squared - _TIE_M2:
                best_s, best_squared = start + along, squared
        return Projection(best_s, math.sqrt(best_squared))


def rounded(points: Sequence[Point], radius_m: float) -> list[Point]:
    """Return `points` with each inner corner replaced by an arc of `radius_m`.

    Parameters
    ----------
    points
        Corners of a polyline in `world` [m].
    radius_m
        Radius of the arcs [m], >= 0; 0 leaves the corners as they are.

    Raises
    ------
    ValueError
        If neighbouring arcs do not fit on a segment or a corner turns straight back.
    """
    points = _without_repeats(points)
    if radius_m <= 0.0 or len(points) < 3:
        return list(points)
    turns = [0.0, *(_turn(*corner) for corner in _corners(points)), 0.0]
    tangents = [radius_m * math.tan(0.5 * abs(turn)) for turn in turns]
    for index, (a, b) in enumerate(itertools.pairwise(points)):
        needed, length = tangents[index] + tangents[index + 1], math.dist(a, b)
        if needed > length + _SAME_POINT_M:
            raise ValueError(
                f"corners of radius {radius_m:g} m need {needed:.2f} m between the points "
                f"{_text(a)} and {_text(b)}, which are {length:.2f} m apart"
            )
    path = [points[0]]
    for (a, b, _), turn, tangent in zip(_corners(points), turns[1:-1], tangents[1:-1], strict=True):
        path += _corner_arc(a, b, turn, tangent, radius_m)
    return [*path, points[-1]]


def _corner_arc(
    a: Point, b: Point, turn_rad: float, tangent_m: float, radius_m: float
) -> list[Point]:
    """Return points on the arc that rounds the corner at `b` when coming from `a`."""
    heading = math.atan2(b[1] - a[1], b[0] - a[0])
    x, y = b[0] - tangent_m * math.cos(heading), b[1] - tangent_m * math.sin(heading)
    count = max(1, math.ceil(abs(turn_rad) / _ARC_STEP_RAD))
    R = math.copysign(radius_m, turn_rad)
    arc = []
    for i in range(count + 1):
        angle = heading + turn_rad * i / count
        arc.append(
            (
                x + R * (math.sin(angle) - math.sin(heading)),
                y - R * (math.cos(angle) - math.cos(heading)),
            )
        )
    return arc


def _corners(points: Sequence[Point]) -> list[tuple[Point, Point, Point]]:
    """Return each inner point with its neighbours."""
    return list(zip(points, points[1:], points[2:], strict=False))


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return the change of direction at `b` [rad]."""
    before = math.atan2(b[1] - a[1], b[0] - a[0])
    after = math.atan2(c[1] - b[1], c[0] - b[0])
    turn = wrap_angle(after - before)
    if abs(turn) > math.radians(175.0):
        raise ValueError(f"the path turns straight back at {_text(b)}; no arc can round that")
    return turn


def _without_repeats(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return `points` without those at the same place as the one before."""
    kept: list[Point] = []
    for x, y in points:
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"a point must be finite, found {_text((x, y))}")
        if not kept or math.dist(kept[-1], (x, y)) > _SAME_POINT_M:
            kept.append((x, y))
    return tuple(kept)


def _text(point: Point) -> str:
    return f"({point[0]:g}, {point[1]:g})"
