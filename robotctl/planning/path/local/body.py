"""Exact outline of a body among the cells of a map and things that move.

All lengths are in cells of the map, times in seconds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import OFFSET, PIECE, discs, discs_over, outline, side_rows
from robotctl.model.polygons import Point, sides_of
from robotctl.planning.map.planning_map import APART

SPACING: Final = 0.25
"""Spacing of the points of the outline."""
COARSE: Final = 1.0
"""The same where a miss by half a cell does not matter."""
TOUCH: Final = -1e9
"""The gap of a body that touches something."""

_FAR_M: Final = 1000.0
_ROUNDING_M: Final = 1e-9


class Body(NamedTuple):
    """A body of convex pieces, with a margin round it."""

    outline: NDArray[np.float64]
    """(n, 3) points of the outlines in order, `SPACING` apart at most; with each the number of the
    point with which its piece ends."""
    coarse: NDArray[np.float64]
    """The same, `COARSE` apart."""
    discs: NDArray[np.float64]
    """(k, 3) circles that cover it."""
    sides: NDArray[np.float64]
    """(m, 4): unit normals that point outwards, the distance of the sides from `base`, and the
    number of their piece."""
    reach: float
    """Distance from `base` to its farthest point."""


class Surroundings(NamedTuple):
    """Things that a body must not touch."""

    blocked: NDArray[np.bool_]
    clearance: NDArray[np.float32]
    """As in `PlanningMap`."""
    moving: NDArray[np.float64]
    """(k, 5) x, y, vx, vy, radius."""


def make_body(footprint: Footprint, margin_m: float | Sequence[float], resolution_m: float) -> Body:
    """Return a footprint grown by a margin, or one for each row of `side_rows`; with sharp corners.

    Raises
    ------
    ValueError
        If margins below 0 leave no body around `base`.
    """
    if not footprint.is_convex:
        return _of_pieces(footprint, np.asarray(margin_m), resolution_m)
    count = len(footprint.corners)
    margins_m = [margin_m] * count if isinstance(margin_m, float) else margin_m
    sides = []
    for ((ax, ay), (bx, by)), each_m in zip(sides_of(footprint.corners), margins_m, strict=True):
        length = math.dist((ax, ay), (bx, by))
        nx, ny = (by - ay) / length, (ax - bx) / length
        sides.append((nx, ny, nx * ax + ny * ay + each_m, 0.0))
    corners = []
    for (ax, ay, a, _), (bx, by, b, _) in zip(sides[-1:] + sides[:-1], sides, strict=True):
        determinant = ax * by - ay * bx
        corners.append(((a * by - b * ay) / determinant, (b * ax - a * bx) / determinant))
    grown = Footprint(tuple(corners))
    if not grown.is_convex:
        raise ValueError("the margins turn a side round")
    scale = np.array([1.0, 1.0, 1.0 / resolution_m, 1.0])
    return Body(
        _loops([corners], resolution_m, SPACING),
        _loops([corners], resolution_m, COARSE),
        discs(grown) / resolution_m,
        np.array(sides) * scale,
        grown.reach_m / resolution_m,
    )


def _of_pieces(footprint: Footprint, margins_m: NDArray[np.float64], resolution_m: float) -> Body:
    """Return a body of several pieces, each grown alone.

    So a piece grows over those beside it, too: that leaves no gap between them.
    """
    rows = side_rows(footprint)
    rows = rows[rows[:, PIECE] >= 0.0]
    rows[:, OFFSET] += margins_m
    pieces: list[list[Point]] = []
    sides, has_base = [], False
    for number in range(len(footprint.pieces)):
        piece = rows[rows[:, PIECE] == number, : OFFSET + 1]
        corners = _enclosed(piece)
        if corners:
            has_base = has_base or bool((piece[:, OFFSET] >= -_ROUNDING_M).all())
            sides.append(np.insert(piece, OFFSET + 1, len(pieces), axis=1))
            pieces.append(corners)
    if not has_base:
        raise ValueError("the margins leave no body around base")
    scale = np.array([1.0, 1.0, 1.0 / resolution_m, 1.0])
    return Body(
        _loops(pieces, resolution_m, SPACING),
        _loops(pieces, resolution_m, COARSE),
        np.concatenate([discs_over(piece) for piece in pieces]) / resolution_m,
        np.concatenate(sides) * scale,
        max(math.hypot(*corner) for piece in pieces for corner in piece) / resolution_m,
    )


def _enclosed(rows: NDArray[np.float64]) -> list[Point]:
    """Return the corners of what lies on the inner side of all rows of a body; empty: nothing.

    A square that is far larger is clipped by each (Sutherland and Hodgman, Reentrant polygon
    clipping, 1974).
    """
    corners: list[Point] = [
        (_FAR_M, -_FAR_M),
        (_FAR_M, _FAR_M),
        (-_FAR_M, _FAR_M),
        (-_FAR_M, -_FAR_M),
    ]
    for nx, ny, offset in rows.tolist():
        kept: list[Point] = []
        for (ax, ay), (bx, by) in sides_of(corners):
            a, b = offset - nx * ax - ny * ay, offset - nx * bx - ny * by
            if a >= 0.0:
                kept.append((ax, ay))
            if a * b < 0.0:
                kept.append((ax + a / (a - b) * (bx - ax), ay + a / (a - b) * (by - ay)))
        corners = kept
    is_thin = len(corners) < 3 or float(np.ptp(corners, axis=0).min()) < _ROUNDING_M
    return [] if is_thin else corners


def _loops(
    pieces: Sequence[Sequence[Point]], resolution_m: float, spacing: float
) -> NDArray[np.float64]:
    """Return `Body.outline` of some pieces, at another spacing perhaps [cells]."""
    loops, count = [], 0
    for piece in pieces:
        points = outline(np.array(piece) / resolution_m, spacing)
        count += len(points)
        loops.append(np.insert(points, 2, count, axis=1))
    return np.concatenate(loops)


@compiled
@borrows
def gap(
    clearance: NDArray[np.float32],
    outline: NDArray[np.float64],
    spacing: float,
    discs: NDArray[np.float64],
    x: float,
    y: float,
    c: float,
    s: float,
) -> float:
    """Return about how far a body is from blocked cells; `TOUCH` where its outline is in one.

    From `APART` on, it is free to move so far less `APART`. `c`, `s`: cosine and sine of its
    heading. The arrays are those of `Surroundings` and `Body`: taking them out of there would cost
    as much as the rest, so callers do it once.
    """
    rows, columns = clearance.shape
    near = np.inf
    for k in range(len(discs)):
        px, py = discs[k, 0], discs[k, 1]
        column, row = x + c * px - s * py, y + s * px + c * py
        if row < 0.0 or column < 0.0 or row >= rows or column >= columns:
            near = -1.0
            break
        near = min(near, clearance[np.uint32(row), np.uint32(column)] - discs[k, 2])
    if near >= APART:
        return near
    k = 0
    while k < len(outline):
        px, py = outline[k, 0], outline[k, 1]
        column, row = x + c * px - s * py, y + s * px + c * py
        if row < 0.0 or column < 0.0 or row >= rows or column >= columns:
            return TOUCH
        clear = clearance[np.uint32(row), np.uint32(column)]
        if clear < 0.0:
            return TOUCH
        k += 1
        # Round this point nothing is nearer than that: the next ones in it need no look.
        if clear > APART + 2.0 * spacing:
            k = min(k + int((clear - APART) / spacing) - 1, int(outline[k - 1, 2]))
    return max(near, 0.0)


@compiled
def is_narrow(space: Surroundings, body: Body, tight: Body, path: NDArray[np.float64]) -> bool:
    """Return whether one body fits at all places of a path, but another, around it, does not.

    The path is that of `RolloutProblem`.
    """
    narrow = False
    for i in range(len(path)):
        x, y, c, s = path[i]
        if gap(space.clearance, tight.outline, SPACING, tight.discs, x, y, c, s) == TOUCH:
            return False
        if gap(space.clearance, body.outline, SPACING, body.discs, x, y, c, s) == TOUCH:
            narrow = True
    return narrow


@compiled
@borrows
def gap_to_moving(
    moving: NDArray[np.float64],
    sides: NDArray[np.float64],
    x: float,
    y: float,
    c: float,
    s: float,
    time: float,
) -> float:
    """Return the gap between a body and what moves, where that is predicted to be at a time.

    Negative where they overlap; at corners up to 1 / sqrt(2) of what it is. The arrays are those of
    `Surroundings` and `Body`, as in `gap`.
    """
    least = np.inf
    for i in range(len(moving)):
        mx = moving[i, 0] + time * moving[i, 2] - x
        my = moving[i, 1] + time * moving[i, 3] - y
        px, py = c * mx + s * my, c * my - s * mx
        nearest, outside, piece = np.inf, -np.inf, 0.0
        for k in range(len(sides)):
            if sides[k, 3] != piece:
                nearest, outside, piece = min(nearest, outside), -np.inf, sides[k, 3]
            outside = max(outside, sides[k, 0] * px + sides[k, 1] * py - sides[k, 2])
        least = min(least, min(nearest, outside) - moving[i, 4])
    return least


@compiled
@borrows
def can_stop(
    space: Surroundings,
    body: Body,
    pose: tuple[float, float, float],
    v: float,
    omega: float,
    vy: float,
    hold_s: float,
    brake_s: float,
) -> bool:
    """Return whether a body may go on with a velocity for some time and then brake on that arc.

    All velocities fall to 0 evenly in `brake_s`. The way is walked in steps in which no point of
    the outline moves by more than what is free round it, or by `SPACING`.
    """
    whole_s = hold_s + 0.5 * brake_s
    angle = omega * whole_s
    reach = float(np.hypot(v, vy)) * whole_s + abs(angle) * body.reach
    clearance, outline, discs = space.clearance, body.outline, body.discs
    moving, sides = space.moving, body.sides
    share = 0.0
    while True:
        half = 0.5 * angle * share
        chord = v * whole_s * share
        if abs(half) > 1e-4:
            chord *= np.sin(half) / half
        x = pose[0] + chord * np.cos(pose[2] + half)
        y = pose[1] + chord * np.sin(pose[2] + half)
        if vy != 0.0:
            across = vy * whole_s * share
            if abs(half) > 1e-4:
                across *= np.sin(half) / half
            x -= across * np.sin(pose[2] + half)
            y += across * np.cos(pose[2] + half)
        c, s = np.cos(pose[2] + 2.0 * half), np.sin(pose[2] + 2.0 * half)
        free = gap(clearance, outline, SPACING, discs, x, y, c, s)
        if free == TOUCH:
            return False
        step = max(free - APART, SPACING)
        if len(moving):
            # From the length of the way to the time: even at first, then ever slower.
            left_s = max(whole_s * (1.0 - share), 0.0)
            time = whole_s * share
            if time > hold_s:
                time = hold_s + brake_s - np.sqrt(2.0 * left_s * brake_s)
            if gap_to_moving(moving, sides, x, y, c, s, time) <= 0.0:
                return False
            step = min(step, 2.0 * SPACING)
        if share >= 1.0 or reach <= 0.0:
            return True
        share = min(1.0, share + step / reach)
