"""The objects of a room: walls, boxes, pillars and small obstacles, as written in TOML.

All are upright prisms on the floor. `height_m` matters to the sensors: see
`firmware_sim.world.world`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Point, Positive, Real, closed
from firmware_sim.world.manner import Manner

Corner: TypeAlias = tuple[float, float]
Colour: TypeAlias = Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$")]
"""Red, green and blue as in `#c03020`."""

BoardSide: TypeAlias = Annotated[int, Field(strict=True, ge=2, le=50)]

WALL_M = 2.5
FURNITURE_M = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """One upright prism.

    Attributes
    ----------
    name
        Name in messages.
    kind
        `wall`, `box`, `pillar` or `obstacle`.
    corners
        Corners of its foot, (k, 2) [m], in the order of its sides.
    solid
        Whether the last corner is joined to the first, so that it has an inside; else a polyline.
    chained
        Whether each corner is joined to the next; else pairs of them are the ends of single sides.
    height_m
        Height of its top above the floor.
    colour
        `#rrggbb`; "" if the file has none.
    """

    name: str
    kind: str
    corners: np.ndarray
    solid: bool
    height_m: float
    colour: str = ""
    chained: bool = True

    def sides(self) -> np.ndarray:
        """Its sides, (n, 4): from x, y to x, y [m]."""
        if not self.chained:
            return self.corners.reshape(-1, 4)
        following = np.roll(self.corners, -1, axis=0)
        rows = np.hstack([self.corners, following])
        return rows if self.solid else rows[:-1]


@closed
@dataclass(frozen=True, slots=True)
class Wall:
    """A polyline, or a row of rectangles about its parts if it has a thickness."""

    points: Annotated[tuple[Point, ...], Field(min_length=2)]
    closed: bool = False
    thickness_m: NotNegative = 0.0
    name: str = "wall"
    height_m: Positive = WALL_M
    colour: Colour | None = None

    def outlines(self) -> list[list[Corner]]:
        """Chains of corners, each closed when its last corner is its first."""
        points = [*self.points, self.points[0]] if self.closed else list(self.points)
        if self.thickness_m == 0.0:
            return [points]
        chains = []
        for (ax, ay), (bx, by) in itertools.pairwise(points):
            # If two points coincide this is no rectangle, which the file's reader reports.
            length = math.hypot(bx - ax, by - ay) or 1.0
            px = -(by - ay) / length * self.thickness_m / 2
            py = (bx - ax) / length * self.thickness_m / 2
            ring = [(ax - px, ay - py), (bx - px, by - py), (bx + px, by + py), (ax + px, ay + py)]
            chains.append([*ring, ring[0]])
        return chains


@closed
@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle, turned by `heading_deg` about its centre."""

    centre: Point
    size: tuple[Positive, Positive]
    heading_deg: Real = 0.0
    name: str = "box"
    kind: Literal["box"] = "box"
    height_m: Positive = FURNITURE_M
    colour: Colour | None = None

    def outlines(self) -> list[list[Corner]]:
        """Its four sides as one closed chain."""
        return [_rectangle(self.centre, self.size, self.heading_deg)]


@closed
@dataclass(frozen=True, slots=True)
class Pillar:
    """A round pillar as a polygon about its circle."""

    kind: Literal["pillar"]
    centre: Point
    radius_m: Positive
    sides: Annotated[int, Field(strict=True, ge=6, le=128)] = 16
    name: str = "pillar"
    height_m: Positive = FURNITURE_M
    colour: Colour | None = None

    def outlines(self) -> list[list[Corner]]:
        """Its sides as one closed chain."""
        return [_polygon(self.centre, self.radius_m, self.sides)]


@closed
@dataclass(frozen=True, slots=True)
class Obstacle:
    """A thing on the floor that is on no map: a round one of `radius_m`, or a box of `size`."""

    centre: Point
    height_m: Positive
    radius_m: Positive | None = None
    size: tuple[Positive, Positive] | None = None
    heading_deg: Real = 0.0
    name: str = "obstacle"
    colour: Colour | None = None

    def __post_init__(self) -> None:
        if (self.radius_m is None) == (self.size is None):
            raise ValueError("an obstacle has either radius_m or size")

    def outlines(self) -> list[list[Corner]]:
        """Its sides as one closed chain."""
        if self.radius_m is not None:
            return [_polygon(self.centre, self.radius_m, 16)]
        if self.size is None:
            raise AssertionError("checked when it was made")
        return [_rectangle(self.centre, self.size, self.heading_deg)]


@closed
@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard printed on paper, flat on the floor, with a margin of one square.

    `at` is its middle, `corners` how many inner corners it has across and along `heading_deg`.
    """

    at: Point
    heading_deg: Real = 0.0
    corners: tuple[BoardSide, BoardSide] = (9, 6)
    square_m: Positive = 0.025


@closed
@dataclass(frozen=True, slots=True)
class Marker:
    """A square marker on something upright, with a white border of one of its cells.

    `at` is the middle of its foot line, `z_m` the height of its middle, and it faces `heading_deg`;
    `side_m` is the side of the black square. `family` is one of OpenCV's dictionaries.
    """

    at: Point
    number: Annotated[int, Field(strict=True, ge=0)]
    heading_deg: Real = 0.0
    z_m: Positive = 0.2
    side_m: Positive = 0.12
    family: Literal["4x4_50", "5x5_100", "6x6_250"] = "4x4_50"


@closed
@dataclass(frozen=True, slots=True)
class Person:
    """Person who walks, in a manner, a closed path of `points`, over and over.

    Who roams, a wanderer or a child that runs, begins at the first point; the path is for the
    others. `speed_m_s` is that of walking, of a wanderer the fastest; a child has its own. A
    stubborn person stands at the last point for `stands_s`, as in a line, before walking on.
    """

    points: Annotated[tuple[Point, ...], Field(min_length=2)]
    speed_m_s: Positive = 0.8
    manner: Manner = Manner.STUBBORN
    stands_s: NotNegative = 0.0

    def __post_init__(self) -> None:
        if self.stands_s > 0.0 and self.manner is not Manner.STUBBORN:
            raise ValueError(f"stands_s: {self.manner.value} found, manner stubborn needed")
        if any(a == b for a, b in itertools.pairwise((*self.points, self.points[0]))):
            raise ValueError("points: two that follow each other coincide")


def _rectangle(centre: Point, size: tuple[float, float], heading_deg: float) -> list[Corner]:
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    if heading_deg % 90.0 == 0.0:
        c, s = round(c), round(s)
    u, v = size[0] / 2, size[1] / 2
    x, y = centre
    ring = [(x + c * a - s * b, y + s * a + c * b) for a, b in ((-u, -v), (u, -v), (u, v), (-u, v))]
    return [*ring, ring[0]]


def _polygon(centre: Point, radius_m: float, sides: int) -> list[Corner]:
    r = radius_m / math.cos(math.pi / sides)
    step = 2 * math.pi / sides
    x, y = centre
    ring = [(x + r * math.cos(step * i), y + r * math.sin(step * i)) for i in range(sides)]
    return [*ring, ring[0]]
