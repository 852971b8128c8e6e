"""The outline of a robot on the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robotctl.model.polygons import (
    Point,
    Polygon,
    Side,
    area,
    convex_pieces,
    distance_m,
    open_sides,
    sides_of,
    surrounds,
    touching_sides,
    turn,
)


@dataclass(frozen=True, slots=True)
class Footprint:
    """A simple polygon in `base`, with `base` inside, and further polygons that move with it.

    Parameters
    ----------
    corners
        Corners, counter-clockwise [m], at least three; none: a robot without extent.
    parts
        Corners of the further polygons, likewise; they may be anywhere.

    Attributes
    ----------
    pieces
        Convex polygons, counter-clockwise, that cover the same floor. What is asked of the body is
        asked of each of them: a point is in the body if it is in one. A convex outline without
        parts is its own and only piece.
    open_sides
        Sides of the polygons, or parts of them, beyond which there is nothing of the body.

    Raises
    ------
    ValueError
        If sides cross or touch, an outline runs clockwise, or leaves `base` outside.
    """

    corners: Polygon = ()
    parts: tuple[Polygon, ...] = ()
    pieces: tuple[Polygon, ...] = field(init=False, repr=False, compare=False)
    open_sides: tuple[Side, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the outline and cut it into pieces."""
        pieces: tuple[Polygon, ...] = ()
        if _is_convex_around_base(self.corners):
            pieces = (self.corners,)
        elif self.corners:
            _check(self.corners)
            if not surrounds(self.corners, (0.0, 0.0)) or not all(
                distance_m((0.0, 0.0), side) > 0.0 for side in sides_of(self.corners)
            ):
                raise ValueError("base must lie inside the outline")
            pieces = convex_pieces(self.corners)
        elif self.parts:
            raise ValueError("parts need an outline beside them")
        for part in self.parts:
            _check(part)
            pieces += convex_pieces(part)
        object.__setattr__(self, "pieces", pieces)
        object.__setattr__(self, "open_sides", tuple(open_sides(self.outlines)))

    @classmethod
    def rectangle(cls, rear_m: float, front_m: float, half_width_m: float) -> Footprint:
        """Return a rectangle from `rear_m` < 0 to `front_m`, its sides equally far away."""
        half_m = half_width_m
        return cls(((front_m, -half_m), (front_m, half_m), (rear_m, half_m), (rear_m, -half_m)))

    @property
    def is_convex(self) -> bool:
        """Whether it is one convex outline, or none."""
        return len(self.pieces) < 2

    @property
    def outlines(self) -> tuple[Polygon, ...]:
        """The polygons as they were given."""
        return (self.corners, *self.parts) if self.corners else ()

    @property
    def points(self) -> tuple[Point, ...]:
        """Corners of all polygons."""
        return self.corners + tuple(corner for part in self.parts for corner in part)

    def depth_m(self, x_m: float, y_m: float) -> float:
        """Return how deep a point of `base` lies below the nearest side [m]; < 0: outside.

        Of a body of several pieces, the piece in which it lies deepest counts.
        """
        return max(
            min(
                ((bx - ax) * (y_m - ay) - (by - ay) * (x_m - ax)) / math.dist((ax, ay), (bx, by))
                for (ax, ay), (bx, by) in sides_of(piece)
            )
            for piece in self.pieces
        )

    @property
    def inscribed_m(self) -> float:
        """Radius of the largest circle about `base` inside of the body [m]."""
        if not self.is_convex:
            return min(distance_m((0.0, 0.0), side) for side in self.open_sides)
        distances = [
            (ax * by - ay * bx) / math.dist((ax, ay), (bx, by))
            for (ax, ay), (bx, by) in sides_of(self.corners)
        ]
        return min(distances, default=0.0)

    @property
    def reach_m(self) -> float:
        """Distance from `base` to the outermost corner [m]."""
        return max((math.hypot(*corner) for corner in self.points), default=0.0)

    @property
    def rear_m(self) -> float:
        """Coordinate of the rearmost corner along the axis ahead [m], below 0."""
        return min((x for x, _ in self.points), default=0.0)

    @property
    def front_m(self) -> float:
        """Distance of the foremost corner ahead of `base` [m]."""
        return max((x for x, _ in self.points), default=0.0)

    @property
    def left_m(self) -> float:
        """Distance of the leftmost corner to the left of `base` [m]."""
        return max((y for _, y in self.points), default=0.0)

    @property
    def right_m(self) -> float:
        """Distance of the rightmost corner to the right of `base` [m]."""
        return max((-y for _, y in self.points), default=0.0)


def _is_convex_around_base(corners: Polygon) -> bool:
    """Return whether a polygon is convex, counter-clockwise, and has `base` inside."""
    if len(corners) < 3:
        return False
    sides = sides_of(corners)
    if not all(ax * by - ay * bx > 0.0 for (ax, ay), (bx, by) in sides):
        return False
    turns = [turn(a, b, c) for (a, b), (_, c) in zip(sides, sides[1:] + sides[:1], strict=True)]
    round_rad = sum(
        math.atan2(ax * by - ay * bx, ax * bx + ay * by) for (ax, ay), (bx, by) in sides
    )
    # A star goes round twice.
    return min(turns) >= 0.0 and math.isclose(round_rad, math.tau)


def _check(corners: Polygon) -> None:
    """Raise ValueError if corners make no simple polygon, counter-clockwise."""
    if len(corners) < 3:
        raise ValueError(f"an outline needs three corners at least, found {len(corners)}")
    if len(set(corners)) < len(corners):
        twice = next(each for each in corners if corners.count(each) > 1)
        raise ValueError(f"an outline has each corner once, found {_place(twice)} twice")
    touching = touching_sides(corners)
    if touching is not None:
        one, other = (f"{_place(a)} to {_place(b)}" for a, b in touching)
        raise ValueError(
            f"sides of an outline may only meet at its corners: the one from {one} meets that "
            f"from {other}"
        )
    if not area(corners) > 0.0:
        raise ValueError("an outline must run counter-clockwise")


def _place(point: Point) -> str:
    """Return a point as text."""
    return f"{point[0]:g}, {point[1]:g}"
