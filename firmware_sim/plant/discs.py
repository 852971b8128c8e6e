"""Contacts of the robot's outline with discs that move: people."""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.plant.plant_state import DT_S
from firmware_sim.plant.walls import END, WITHIN, put_wall
from native_kernels.compiled import borrows, compiled


@compiled
@borrows
def nearest_point(x: float, y: float, outline: np.ndarray) -> tuple[float, float, float]:
    """Return a point's distance from the outline [m], negative inside, and the nearest point of it.

    All coordinates are in base.
    """
    best, near_x, near_y = np.inf, 0.0, 0.0
    is_inside, piece = False, 0
    while piece < len(outline):
        distance, side_x, side_y = nearest_of_piece(x, y, outline, piece)
        is_inside = is_inside or distance <= 0.0
        if abs(distance) < best:
            best, near_x, near_y = abs(distance), side_x, side_y
        piece = int(outline[piece, END])
    return (-best if is_inside else best), near_x, near_y


@compiled
@borrows
def nearest_of_piece(
    x: float, y: float, outline: np.ndarray, piece: int
) -> tuple[float, float, float]:
    """Return the same of a convex piece alone, without the sides that it shares with others."""
    depth, best = -np.inf, np.inf
    near_x, near_y = 0.0, 0.0
    for i in range(piece, int(outline[piece, END])):
        vx, vy, nx, ny = outline[i, 0], outline[i, 1], outline[i, 2], outline[i, 3]
        off_x, off_y = x - vx, y - vy
        depth = max(depth, off_x * nx + off_y * ny)
        if outline[i, WITHIN] > 0.0:
            continue
        along = min(max(off_y * nx - off_x * ny, 0.0), outline[i, 4])
        side_x, side_y = vx - along * ny, vy + along * nx
        distance = math.hypot(x - side_x, y - side_y)
        if distance < best:
            best, near_x, near_y = distance, side_x, side_y
    return (best if depth > 0.0 else -best), near_x, near_y


@compiled
@borrows
def disc_rows(
    body: np.ndarray,
    p: np.ndarray,
    outline: np.ndarray,
    discs: np.ndarray,
    rows: np.ndarray,
    count: int,
) -> int:
    """Append rows for the discs (n, 3) that may be touched within the next step, as for walls.

    A disc stands still within a step: people do not push the robot.
    """
    b, c = body[0], p[0]
    cos, sin = math.cos(b.theta), math.sin(b.theta)
    ahead = 1.0e-3 + 1.5 * DT_S * (abs(b.vx) + abs(b.vy) + abs(b.omega) * c.reach)
    for i in range(len(discs)):
        off_x, off_y, radius = discs[i, 0] - b.x, discs[i, 1] - b.y, discs[i, 2]
        if math.hypot(off_x, off_y) > c.reach + radius + ahead:
            continue
        x, y = cos * off_x + sin * off_y, -sin * off_x + cos * off_y
        piece = 0
        while piece < len(outline):
            distance, near_x, near_y = nearest_of_piece(x, y, outline, piece)
            if distance - radius < ahead and distance != 0.0 and math.isfinite(distance):
                nx, ny = (near_x - x) / distance, (near_y - y) / distance
                px, py = near_x - c.com_x, near_y - c.com_y
                count = put_wall(rows, count, nx, ny, px, py, distance - radius)
            piece = int(outline[piece, END])
    return count
