"""Contacts of the robot's outline with walls: a grid for the far ones, exact gaps for the near.

The grid lists for each cell the walls that the outline can reach while its base is in that cell;
most cells list none, so that driving in the open costs one look-up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from firmware_sim.plant.contact import JW, JX, JY, SLOP_M, SOFT, TARGET, put_row
from firmware_sim.plant.plant_state import DT_S
from native_kernels.compiled import borrows, compiled

CELL_M = 0.25
NEAR_M = 0.05
"""Gap within which the grid lists a wall [m]; must exceed the robot's travel in one step."""
END_M = 5.0e-4
"""Distance [m] from a corner of the outline within which a wall's end makes no own contact."""


# Columns of an outline: of each corner, and the side that begins there.
X, Y, NORMAL_X, NORMAL_Y, LENGTH, END, CENTRE_X, CENTRE_Y, WITHIN = range(9)


def body_outline(pieces: Sequence[tuple[tuple[float, float], ...]]) -> np.ndarray:
    """Convex pieces of a body, counter-clockwise, (m, 9).

    Of each: corner, outward normal and length of its side, number of the row after those of its
    piece, a point within that, and 1 for a side that two pieces share.
    """
    sides = {side for piece in pieces for side in _sides(piece)}
    parts, end = [], 0
    for piece in pieces:
        points = np.array(piece, dtype=np.float64)
        side = np.roll(points, -1, axis=0) - points
        length = np.hypot(side[:, 0], side[:, 1])[:, None]
        normal = np.stack([side[:, 1], -side[:, 0]], axis=1) / length
        end += len(points)
        rest = np.tile([end, *points.mean(axis=0)], (len(points), 1))
        shared = [[float((b, a) in sides)] for a, b in _sides(piece)]
        parts.append(np.hstack([points, normal, length, rest, shared]))
    return np.ascontiguousarray(np.vstack(parts))


def _sides(piece: tuple[tuple[float, float], ...]) -> list[tuple[tuple[float, float], ...]]:
    return list(zip(piece, piece[1:] + piece[:1], strict=True))


def wall_grid(segments: np.ndarray, reach_m: float) -> tuple[tuple[float, float], np.ndarray]:
    """Build the grid of walls within reach, large enough for all of them.

    Returns
    -------
    tuple
        Corner x, y [m]; table of int32: columns, rows, then the starts of each cell's list (one
        more than there are cells), then the lists of wall numbers.
    """
    margin = reach_m + NEAR_M
    ends = segments.reshape(-1, 2) if len(segments) else np.zeros((1, 2))
    low, high = ends.min(axis=0) - 2 * margin, ends.max(axis=0) + 2 * margin
    columns, rows = (math.ceil(side) for side in (high - low) / CELL_M)
    limit = margin + CELL_M / math.sqrt(2.0)
    x = low[0] + (np.arange(columns) + 0.5) * CELL_M
    y = low[1] + (np.arange(rows) + 0.5) * CELL_M
    cells, numbers = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for number, (ax, ay, bx, by) in enumerate(segments):
        near_x = np.flatnonzero((x >= min(ax, bx) - limit) & (x <= max(ax, bx) + limit))
        near_y = np.flatnonzero((y >= min(ay, by) - limit) & (y <= max(ay, by) + limit))
        off_x, off_y = x[near_x] - ax, y[near_y, None] - ay
        dx, dy = bx - ax, by - ay
        t = np.clip((off_x * dx + off_y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        row, column = np.nonzero(np.hypot(off_x - t * dx, off_y - t * dy) <= limit)
        cells.append(near_y[row] * columns + near_x[column])
        numbers.append(np.full(len(row), number))
    cell = np.concatenate(cells)
    entries = np.concatenate(numbers)[np.argsort(cell, kind="stable")]
    count = columns * rows
    starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=count))]) + 3 + count
    corner = float(low[0]), float(low[1])
    return corner, np.concatenate([[columns, rows], starts, entries]).astype(np.int32)


@compiled
@borrows
def cell_walls(x: float, y: float, grid: np.ndarray) -> tuple[int, int]:
    """Range in `grid` of the walls near a place relative to its corner; empty outside the grid."""
    column = math.floor(x / CELL_M)
    row = math.floor(y / CELL_M)
    if column < 0 or row < 0 or column >= grid[0] or row >= grid[1]:
        return 0, 0
    cell = 2 + row * grid[0] + column
    return int(grid[cell]), int(grid[cell + 1])


@compiled
@borrows
def wall_rows(
    body: np.ndarray,
    p: np.ndarray,
    outline: np.ndarray,
    segments: np.ndarray,
    grid: np.ndarray,
    rows: np.ndarray,
) -> int:
    """Fill in the rows for walls that may be touched within the next step; returns their number.

    `rows` are those after the rows of the grips, here and in all functions of this module.
    """
    b, c = body[0], p[0]
    first, last = cell_walls(b.x - c.grid_x, b.y - c.grid_y, grid)
    if first == last:
        return 0
    cos, sin = math.cos(b.theta), math.sin(b.theta)
    ahead = 1.0e-3 + 1.5 * DT_S * (abs(b.vx) + abs(b.vy) + abs(b.omega) * c.reach)
    count = 0
    for entry in range(first, last):
        wall = segments[grid[entry]]
        ax, ay = wall[0] - b.x, wall[1] - b.y
        bx, by = wall[2] - b.x, wall[3] - b.y
        dx, dy = bx - ax, by - ay
        length = math.hypot(dx, dy)
        dx, dy = dx / length, dy / length
        along = min(max(-(ax * dx + ay * dy), 0.0), length)
        if math.hypot(ax + along * dx, ay + along * dy) > c.reach + ahead:
            continue
        # From here on in base.
        ax, ay = cos * ax + sin * ay, -sin * ax + cos * ay
        bx, by = cos * bx + sin * by, -sin * bx + cos * by
        piece = 0
        while piece < len(outline):
            end = int(outline[piece, END])
            # Past the end of a wall, a piece may have corners on both sides of its line.
            if is_near(ax, ay, bx, by, ahead, outline, piece, end):
                count = corner_rows(
                    c.com_x, c.com_y, ax, ay, bx, by, length, ahead, outline, piece, rows, count
                )
                count = end_row(c.com_x, c.com_y, ax, ay, ahead, outline, piece, rows, count)
                count = end_row(c.com_x, c.com_y, bx, by, ahead, outline, piece, rows, count)
            piece = end
    return count


@compiled
@borrows
def is_near(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    ahead: float,
    outline: np.ndarray,
    piece: int,
    end: int,
) -> bool:
    """Whether no side of a piece keeps a wall from a to b away from it, all in base."""
    for i in range(piece, end):
        vx, vy, nx, ny = outline[i, X], outline[i, Y], outline[i, NORMAL_X], outline[i, NORMAL_Y]
        from_a = (ax - vx) * nx + (ay - vy) * ny
        from_b = (bx - vx) * nx + (by - vy) * ny
        if from_a >= ahead and from_b >= ahead:
            return False
    return True


@compiled
@borrows
def corner_rows(
    com_x: float,
    com_y: float,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    length: float,
    ahead: float,
    outline: np.ndarray,
    piece: int,
    rows: np.ndarray,
    count: int,
) -> int:
    """Rows of a piece's corners against the face of a wall from a to b, all in base."""
    dx, dy = (bx - ax) / length, (by - ay) / length
    nx, ny = -dy, dx
    if (outline[piece, CENTRE_X] - ax) * nx + (outline[piece, CENTRE_Y] - ay) * ny < 0.0:
        nx, ny = -nx, -ny
    for i in range(piece, int(outline[piece, END])):
        vx, vy = outline[i, 0], outline[i, 1]
        gap = (vx - ax) * nx + (vy - ay) * ny
        along = (vx - ax) * dx + (vy - ay) * dy
        if gap < ahead and 0.0 <= along <= length:
            count = put_wall(rows, count, nx, ny, vx - com_x, vy - com_y, gap)
    return count


@compiled
@borrows
def end_row(
    com_x: float,
    com_y: float,
    ex: float,
    ey: float,
    ahead: float,
    outline: np.ndarray,
    piece: int,
    rows: np.ndarray,
    count: int,
) -> int:
    """Row of a wall's end at e against the sides of a piece, in base."""
    best, side = -np.inf, -1
    for i in range(piece, int(outline[piece, END])):
        gap = (ex - outline[i, 0]) * outline[i, 2] + (ey - outline[i, 1]) * outline[i, 3]
        if gap > best:
            best, side = gap, i
    if best >= ahead or outline[side, WITHIN] > 0.0:
        return count
    nx, ny = outline[side, 2], outline[side, 3]
    along = (ex - outline[side, 0]) * -ny + (ey - outline[side, 1]) * nx
    if along < END_M or along > outline[side, 4] - END_M:
        return count
    return put_wall(rows, count, -nx, -ny, ex - com_x, ey - com_y, best)


@compiled
@borrows
def put_wall(
    rows: np.ndarray, count: int, nx: float, ny: float, px: float, py: float, gap: float
) -> int:
    """Append the pair of rows of one wall contact, if there is room; returns the new number.

    The body may close no more than the gap within the step. A penetration is resolved at no more
    than 0.1 m/s.
    """
    i = 2 * count
    if i >= len(rows):
        return count
    put_row(rows, i, nx, ny, px, py)
    put_row(rows, i + 1, -ny, nx, px, py)
    rows[i, TARGET] = min(-(gap - SLOP_M) / DT_S, 0.1)
    rows[i, SOFT] = 0.0
    rows[i + 1, SOFT] = 0.0
    return count + 1


@compiled
@borrows
def approach_speed(body: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Speed of the body along the direction of a row [m/s]."""
    b = body[0]
    return float(rows[i, JX] * b.vx + rows[i, JY] * b.vy + rows[i, JW] * b.omega)
