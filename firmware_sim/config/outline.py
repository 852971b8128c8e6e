"""Outlines of a robot: simple polygons, and the triangles of those that are not convex."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_sim.config.quantities import Point, closed
from firmware_sim.errors import nearest

FARTHEST_CORNER_M = 10.0


@closed
@dataclass(frozen=True, slots=True)
class BodyPart:
    """A table `[[body.part]]`: what sticks out of the outline, or lies beside it."""

    name: str
    outline: tuple[Point, ...]
    states: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_outline("outline", self.outline)


@closed
@dataclass(frozen=True, slots=True)
class BodySection:
    """The table `[body]`: the outline that robotctl believes in, and parts beside it.

    A part with `states` is there in these; `state` is the one at the start, by its number.
    """

    outline: tuple[Point, ...] = ()
    states: tuple[str, ...] = ()
    state: int | None = None
    part: tuple[BodyPart, ...] = ()

    def __post_init__(self) -> None:
        if self.outline:
            check_outline("outline", self.outline)
        if self.state is not None and not 0 <= self.state < len(self.states):
            last = len(self.states) - 1
            allowed = f"allowed are 0 to {last}" if self.states else "there are no states"
            raise ValueError(f"state: {self.state}; {allowed}")
        for part in self.part:
            for name in part.states:
                if name not in self.states:
                    hint = nearest(name, self.states)
                    raise ValueError(f"part: {part.name} names no such state as {name!r}{hint}")


def check_outline(key: str, corners: tuple[Point, ...]) -> None:
    """Raise ValueError if an outline crosses itself, or reaches too far."""
    if len(corners) < 3:
        raise ValueError(f"{key}: {len(corners)} corners; an outline needs at least 3")
    farthest = max(max(map(abs, corner)) for corner in corners)
    if farthest > FARTHEST_CORNER_M:
        raise ValueError(
            f"{key}: a corner at {farthest:g} m; allowed are {FARTHEST_CORNER_M:g} m from base"
        )
    if any(turn == 0.0 for turn in _turns(corners)) or _crosses_itself(corners):
        raise ValueError(f"{key}: the outline crosses itself or has a corner on a straight side")


def is_convex(corners: tuple[Point, ...]) -> bool:
    """Whether an outline turns one way only."""
    turns = _turns(corners)
    return all(turn > 0.0 for turn in turns) or all(turn < 0.0 for turn in turns)


def pieces_of(corners: tuple[Point, ...]) -> list[tuple[Point, ...]]:
    """Convex pieces of a simple polygon, counter-clockwise: itself, or triangles cut off it."""
    area = sum(
        a[0] * b[1] - a[1] * b[0] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    )
    left = list(corners if area > 0.0 else corners[::-1])
    if is_convex(corners):
        return [tuple(left)]
    pieces: list[tuple[Point, ...]] = []
    while len(left) > 3:
        i = next(i for i in range(len(left)) if _is_ear(left, i))
        pieces.append((left[i - 1], left[i], left[(i + 1) % len(left)]))
        del left[i]
    return [*pieces, tuple(left)]


def _is_ear(corners: list[Point], i: int) -> bool:
    """Whether a corner can be cut off: no other one lies in its triangle."""
    a, b, c = corners[i - 1], corners[i], corners[(i + 1) % len(corners)]
    if _turned(a, b, c) <= 0.0:
        return False
    return not any(
        _turned(a, b, p) >= 0.0 and _turned(b, c, p) >= 0.0 and _turned(c, a, p) >= 0.0
        for p in corners
        if p not in (a, b, c)
    )


def _turned(a: Point, b: Point, c: Point) -> float:
    """Twice the area of a triangle, above 0 if counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _turns(corners: tuple[Point, ...]) -> list[float]:
    """Change of direction at each corner [rad]; 0 where there is none, or it goes back."""
    sides = [
        (b[0] - a[0], b[1] - a[1]) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    return [
        math.atan2(cross, a[0] * b[0] + a[1] * b[1])
        if (cross := a[0] * b[1] - a[1] * b[0])
        else 0.0
        for a, b in zip(sides, sides[1:] + sides[:1], strict=True)
    ]


def _crosses_itself(corners: tuple[Point, ...]) -> bool:
    """Whether two sides that are not neighbours have a point in common."""
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
    for i, (a, b) in enumerate(sides):
        for c, d in sides[i + 2 : len(sides) - (i == 0)]:
            before, after = _turned(a, b, c), _turned(a, b, d)
            first, last = _turned(c, d, a), _turned(c, d, b)
            low_x, high_x = (
                max(min(a[0], b[0]), min(c[0], d[0])),
                min(max(a[0], b[0]), max(c[0], d[0])),
            )
            low_y, high_y = (
                max(min(a[1], b[1]), min(c[1], d[1])),
                min(max(a[1], b[1]), max(c[1], d[1])),
            )
            near = low_x <= high_x and low_y <= high_y
            if near and before * after <= 0.0 and first * last <= 0.0:
                return True
    return False
