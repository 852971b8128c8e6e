"""Simple polygons in plain numbers: what is none, what is inside, and convex pieces of one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise
from typing import Final, TypeAlias

Point: TypeAlias = tuple[float, float]
Side: TypeAlias = tuple[Point, Point]
Polygon: TypeAlias = tuple[Point, ...]

_FLAT: Final = 1e-9
"""Area below which three corners are in a line [m^2]."""
_BESIDE_M: Final = 1e-6
"""How far beside a side is looked for what lies there [m]."""


def sides_of(polygon: Sequence[Point]) -> list[Side]:
    """Return the sides of a polygon, from corner to corner."""
    return list(zip(polygon, [*polygon[1:], *polygon[:1]], strict=True))


def turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of a triangle; above 0 if it goes round to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def area(polygon: Sequence[Point]) -> float:
    """Return twice the area of a polygon; above 0 if it goes round to the left."""
    return sum(ax * by - ay * bx for (ax, ay), (bx, by) in sides_of(polygon))


def distance_m(point: Point, side: Side) -> float:
    """Return the distance of a point from a side [m]."""
    (ax, ay), (bx, by) = side
    length = math.dist(*side)
    along = ((point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)) / length
    if 0.0 <= along <= length:
        return abs(turn(*side, point)) / length
    return min(math.dist(point, side[0]), math.dist(point, side[1]))


def surrounds(polygon: Sequence[Point], point: Point) -> bool:
    """Return whether a point is inside a polygon: a line from it crosses an odd number of sides."""
    x, y = point
    inside = False
    for (ax, ay), (bx, by) in sides_of(polygon):
        if (ay > y) != (by > y):
            inside ^= ax + (y - ay) / (by - ay) * (bx - ax) > x
    return inside


def touching_sides(polygon: Sequence[Point]) -> tuple[Side, Side] | None:
    """Return two sides of a polygon that cross, touch or fold back; None: it is simple."""
    sides = sides_of(polygon)
    for (i, one), (j, other) in combinations(enumerate(sides), 2):
        if j == i + 1 or (i == 0 and j == len(sides) - 1):
            a, b, c = (*one, other[1]) if j == i + 1 else (*other, one[1])
            onwards = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
            if turn(a, b, c) == 0.0 and onwards <= 0.0:
                return one, other
        elif meet(one, other):
            return one, other
    return None


def meet(one: Side, other: Side) -> bool:
    """Return whether two sides have a point in common."""
    (a, b), (c, d) = one, other
    if any(max(a[i], b[i]) < min(c[i], d[i]) or max(c[i], d[i]) < min(a[i], b[i]) for i in (0, 1)):
        return False
    return turn(a, b, c) * turn(a, b, d) <= 0.0 and turn(c, d, a) * turn(c, d, b) <= 0.0


def convex_pieces(polygon: Polygon) -> tuple[Polygon, ...]:
    """Return convex polygons, side by side, that make up a simple one, all to the left round.

    Triangles are cut off, the least sharp first, and joined again where the result is convex
    (Hertel and Mehlhorn, Fast triangulation of simple polygons, 1983): at most four times as many
    as the fewest that would do.
    """
    corners = [
        b
        for (a, b), (_, c) in zip(
            sides_of(polygon), [*sides_of(polygon)[1:], sides_of(polygon)[0]], strict=True
        )
        if abs(turn(a, b, c)) > _FLAT
    ]
    pieces = _triangles(corners)
    one = 0
    while one < len(pieces):
        for other in range(one + 1, len(pieces)):
            joined = _joined(pieces[one], pieces[other])
            if joined is not None and is_convex(joined):
                pieces[one] = joined
                del pieces[other]
                break
        else:
            one += 1
    return tuple(pieces)


def is_convex(polygon: Sequence[Point]) -> bool:
    """Return whether a polygon that goes round once to the left turns nowhere to the right."""
    sides = sides_of(polygon)
    return all(
        turn(a, b, c) >= -_FLAT
        for (a, b), (_, c) in zip(sides, [*sides[1:], sides[0]], strict=True)
    )


def _triangles(corners: Sequence[Point]) -> list[Polygon]:
    """Return the triangles of a polygon."""
    if len(corners) < 3:
        raise ValueError("the outline has no area")
    left, triangles = list(corners), []
    while len(left) > 3:
        ears = [(_sharpness(*ear), i, ear) for i, ear in enumerate(_ears(left)) if ear is not None]
        if not ears:
            raise ValueError("the outline has corners too near to each other")
        _, i, ear = min(ears)
        triangles.append(ear)
        del left[i]
    return [*triangles, (left[0], left[1], left[2])]


def _ears(corners: Sequence[Point]) -> Iterator[tuple[Point, Point, Point] | None]:
    """Yield for each corner the triangle with those beside it; None if it cannot be cut off."""
    for i, b in enumerate(corners):
        a, c = corners[i - 1], corners[(i + 1) % len(corners)]
        free = turn(a, b, c) > _FLAT and not any(
            turn(a, b, p) >= 0.0 and turn(b, c, p) >= 0.0 and turn(c, a, p) >= 0.0
            for p in corners
            if p not in (a, b, c)
        )
        yield (a, b, c) if free else None


def _sharpness(a: Point, b: Point, c: Point) -> float:
    """Return the longest side by the height of a triangle over it."""
    longest = max(math.dist(a, b), math.dist(b, c), math.dist(c, a))
    return longest * longest / turn(a, b, c)


def _joined(one: Polygon, other: Polygon) -> Polygon | None:
    """Return two polygons as one, without the side between them; None: there is none."""
    theirs = {(b, a): j for j, (a, b) in enumerate(sides_of(other))}
    for i, side in enumerate(sides_of(one)):
        j = theirs.get(side)
        if j is not None:
            rest = (other[j:] + other[:j])[2:]
            return one[i + 1 :] + one[: i + 1] + rest
    return None


def open_sides(polygons: Sequence[Polygon]) -> list[Side]:
    """Return what of the sides of polygons, all to the left round, no other one covers."""
    if len(polygons) < 2:
        return [side for polygon in polygons for side in sides_of(polygon)]
    found = []
    for polygon in polygons:
        others = [each for each in polygons if each is not polygon]
        for side in sides_of(polygon):
            for a, b in _parts(side, others):
                length = math.dist(a, b)
                middle = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
                away_x = _BESIDE_M * (b[1] - a[1]) / length
                away_y = _BESIDE_M * (a[0] - b[0]) / length
                beside = middle[0] + away_x, middle[1] + away_y
                if not any(surrounds(each, beside) for each in others):
                    found.append((a, b))
    return found


def _parts(side: Side, others: Sequence[Polygon]) -> Iterator[Side]:
    """Yield a side in parts, from where it meets others to where it does again."""
    (ax, ay), (bx, by) = side
    length = math.dist(*side)
    cuts = {0.0, 1.0}
    for c, d in (each for other in others for each in sides_of(other)):
        left, right = turn(*side, c), turn(*side, d)
        if left * right < 0.0:
            share = left / (left - right)
            x, y = c[0] + share * (d[0] - c[0]), c[1] + share * (d[1] - c[1])
            cuts.add(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length**2)
        on_line = [each for each, off in ((c, left), (d, right)) if abs(off) < _BESIDE_M * length]
        for x, y in on_line:
            cuts.add(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length**2)
    shares = sorted(share for share in cuts if 0.0 <= share <= 1.0)
    for first, last in pairwise(shares):
        if (last - first) * length > _BESIDE_M:
            yield (
                (ax + first * (bx - ax), ay + first * (by - ay)),
                (ax + last * (bx - ax), ay + last * (by - ay)),
            )
