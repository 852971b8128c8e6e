"""Printed chessboards on the floor, for the calibration of a camera."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_sim.world.shapes import Board
from native_kernels.compiled import borrows, compiled

PAPER: Final = 225.0
INK: Final = 25.0
SAMPLES: Final = 5
"""Points along a pixel's ray, and across it, whose mean is the pixel."""
# Columns of a board.
X: Final = 0
Y: Final = 1
COS: Final = 2
SIN: Final = 3
ALONG: Final = 4
ACROSS: Final = 5
SQUARE: Final = 6


def board_rows(boards: tuple[Board, ...]) -> np.ndarray:
    """Return boards as rows, (n, 7): middle, direction, half the size along and across."""
    rows = [
        (
            *board.at,
            math.cos(math.radians(board.heading_deg)),
            math.sin(math.radians(board.heading_deg)),
            0.5 * (board.corners[1] + 1) * board.square_m,
            0.5 * (board.corners[0] + 1) * board.square_m,
            board.square_m,
        )
        for board in boards
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


@compiled
@borrows
def board_value(board: np.ndarray, x: float, y: float) -> float:
    """Brightness of a point of a board, -1 beside it; x, y in world from its middle."""
    along = board[COS] * x + board[SIN] * y
    across = -board[SIN] * x + board[COS] * y
    size = board[SQUARE]
    beyond = max(abs(along) - board[ALONG], abs(across) - board[ACROSS])
    if beyond > size:
        return -1.0
    if beyond > 0.0:
        return PAPER
    i = math.floor((along + board[ALONG]) / size)
    j = math.floor((across + board[ACROSS]) / size)
    return INK if (i + j) % 2 == 0 else PAPER


@compiled
@borrows
def add_board(
    board: np.ndarray,
    pixels: np.ndarray,
    showing: np.ndarray,
    pose: np.ndarray,
    camera_height: float,
    turn: float,
    bright: np.ndarray,
    row: np.ndarray,
) -> None:
    """Lay a board over the floor in a row of light.

    Parameters
    ----------
    board
        A row of `board_rows`.
    pixels
        Pixels of the row, of `PIXEL`.
    showing
        Whether each of them shows the floor, (width,).
    pose
        x, y of the camera, and cosine and sine of its direction, in world.
    camera_height, turn
        Height of the camera [m]; angle between neighbouring pixels [rad].
    bright
        Light on the floor at each pixel, times its gain, (width,).
    row
        Light of the pixels, (3 * width,), changed.
    """
    limit = board[ALONG] + board[ACROSS] + 2.0 * board[SQUARE]
    for u in range(len(pixels)):
        p = pixels[u]
        if not showing[u]:
            continue
        far = float(p.floor)
        ahead = pose[2] * p.ahead - pose[3] * p.left
        left = pose[3] * p.ahead + pose[2] * p.left
        x, y = pose[0] + far * ahead - board[X], pose[1] + far * left - board[Y]
        if abs(x) > limit or abs(y) > limit:
            continue
        reach = math.hypot(far, camera_height)
        wide = reach * turn / SAMPLES
        long = wide * reach / camera_height
        total, count = 0.0, 0
        for i in range(SAMPLES):
            a = (i - 0.5 * (SAMPLES - 1)) * long
            for j in range(SAMPLES):
                b = (j - 0.5 * (SAMPLES - 1)) * wide
                value = board_value(board, x + a * ahead - b * left, y + a * left + b * ahead)
                if value >= 0.0:
                    total += value
                    count += 1
        if count > 0:
            share = 1.0 - count / SAMPLES**2
            light = bright[u] * total / SAMPLES**2
            for c in range(3):
                row[3 * u + c] = share * row[3 * u + c] + light
