"""Exact ray casting on occupancy grids: how far a beam goes before it enters an occupied cell.

A ray visits the cells of the classic grid traversal (Amanatides and Woo 1987), but steps over many
at once. For each cell and each quadrant of directions the map keeps the side of the largest square
that is free of obstacles, has the cell in its corner, and extends into the quadrant. A ray in the
cell can go to where it leaves that square: nothing in between can stop it. In a square of side 1
this is a step of the classic traversal. The cell behind the square is found as there: on the axis
that was crossed by counting, on the other by the ray's equation. So the result is that of the
traversal, to rounding, and in rooms a ray takes four to five jumps instead of sixty steps.

Rays go in blocks of one beam for many poses, all jumping at once, so that the arithmetic of a jump
is vector code; those that have arrived leave the block.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.grid_map import OCCUPIED_FROM, GridMap

_BLOCK: Final = 256
_PARALLEL: Final = 1.0e30
"""Cells to the next row or column for a ray that runs along it."""
_LARGEST: Final = 255

# Rows of a block's state.
_U, _V, _DU, _DV, _PER_U, _PER_V, _T = range(7)
_COLUMN, _ROW, _SIDE, _POSE = range(4)


class RangeCaster:
    """Casts rays on one map.

    Parameters
    ----------
    grid
        The map; cells with at least 50 percent stop a ray. Unknown cells and what is outside of the
        map do not.
    is_small
        Keep one square for each cell, with the cell in its middle: a quarter of the memory, and
        more jumps.
    """

    def __init__(self, grid: GridMap, *, is_small: bool = False) -> None:
        # A border of one cell ends the rays that leave the map.
        passes = np.zeros((grid.shape[0] + 2, grid.shape[1] + 2), np.uint8)
        np.less(grid.cells, OCCUPIED_FROM, out=passes[1:-1, 1:-1])
        if is_small:
            _widen(passes)
        self._squares = passes[None] if is_small else _largest_squares(passes)
        self._origin = grid.origin
        self._resolution_m = grid.resolution_m

    def cast(
        self, poses: NDArray[np.float64], angles_rad: NDArray[np.float64], max_range_m: float
    ) -> NDArray[np.float64]:
        """Return the ranges of beams of a sensor at many poses.

        Parameters
        ----------
        poses
            Poses of the sensor in world, (n, 3) [m, m, rad]; may lie outside of the map.
        angles_rad
            Directions of the beams from the sensor's heading, (k,) [rad].
        max_range_m
            Maximum range [m].

        Returns
        -------
        NDArray
            (k, n) [m]: to where beam k from pose n enters the first cell that stops it; 0 if it
            starts in one; inf if there is none within `max_range_m`.
        """
        heading = poses[:, 2] - self._origin.theta_rad
        c, s = math.cos(self._origin.theta_rad), math.sin(self._origin.theta_rad)
        x, y = poses[:, 0] - self._origin.x_m, poses[:, 1] - self._origin.y_m
        ranges = np.empty((len(angles_rad), len(poses)))
        _cast(
            (c * x + s * y) / self._resolution_m + 1.0,
            (c * y - s * x) / self._resolution_m + 1.0,
            np.cos(heading),
            np.sin(heading),
            np.cos(angles_rad),
            np.sin(angles_rad),
            self._squares,
            max_range_m / self._resolution_m,
            ranges,
        )
        ranges *= self._resolution_m
        return ranges


@compiled
def _largest_squares(passes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the side of the largest free square at each cell, (4, rows, columns).

    Plane 1 is for rays to smaller columns, 2 to smaller rows, 3 to both, 0 to none of the two. A
    square is one larger than the least of the three that start beside it.
    """
    rows, columns = passes.shape
    squares = np.zeros((4, rows, columns), np.uint8)
    for plane in range(4):
        right = -1 if plane & 1 else 1
        up = -1 if plane & 2 else 1
        for i in range(1, rows - 1):
            row = rows - 1 - i if up > 0 else i
            for j in range(1, columns - 1):
                column = columns - 1 - j if right > 0 else j
                if passes[row, column]:
                    beside = min(
                        squares[plane, row + up, column],
                        squares[plane, row, column + right],
                        squares[plane, row + up, column + right],
                    )
                    squares[plane, row, column] = min(beside + 1, _LARGEST)
    return squares


@compiled
def _widen(sides: NDArray[np.uint8]) -> None:
    """Replace 1 of cells that rays pass by how far it is free around them into all quadrants."""
    rows, columns = sides.shape
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            if sides[i, j]:
                above = min(sides[i - 1, j - 1], sides[i - 1, j], sides[i - 1, j + 1])
                sides[i, j] = min(min(above, sides[i, j - 1]) + 1, _LARGEST)
    for i in range(rows - 2, 0, -1):
        for j in range(columns - 2, 0, -1):
            below = min(sides[i + 1, j - 1], sides[i + 1, j], sides[i + 1, j + 1])
            sides[i, j] = min(sides[i, j], min(below, sides[i, j + 1]) + 1)


@compiled
def _cast(
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    pose_cos: NDArray[np.float64],
    pose_sin: NDArray[np.float64],
    beam_cos: NDArray[np.float64],
    beam_sin: NDArray[np.float64],
    squares: NDArray[np.uint8],
    max_range: float,
    ranges: NDArray[np.float64],
) -> None:
    """Fill `ranges` (beams, poses); positions u, v and all lengths in cells of the padded map."""
    planes, rows, columns = squares.shape
    flat = squares.ravel()
    real = np.empty((7, _BLOCK))
    whole = np.empty((4, _BLOCK), np.int32)
    plane = np.empty(_BLOCK, np.int64)
    for start in range(0, len(u), _BLOCK):
        for k in range(len(beam_cos)):
            n = min(_BLOCK, len(u) - start)
            for i in range(n):
                c, s = pose_cos[start + i], pose_sin[start + i]
                du, dv = c * beam_cos[k] - s * beam_sin[k], s * beam_cos[k] + c * beam_sin[k]
                real[_U, i], real[_V, i] = u[start + i], v[start + i]
                real[_DU, i], real[_DV, i] = du, dv
                real[_PER_U, i] = 1.0 / du if du != 0.0 else _PARALLEL
                real[_PER_V, i] = 1.0 / dv if dv != 0.0 else _PARALLEL
                quadrant = (1 if du < 0.0 else 0) + (2 if dv < 0.0 else 0)
                plane[i] = quadrant % planes * rows * columns
                whole[_POSE, i] = start + i
            _enter(n, real, whole, rows, columns)
            while n > 0:
                for i in range(n):
                    cell = plane[i] + whole[_ROW, i] * columns + whole[_COLUMN, i]
                    whole[_SIDE, i] = flat[np.uint64(cell)]
                _jump(n, real, whole)
                n = _retire(n, real, whole, plane, rows, columns, max_range, ranges[k])


@compiled
def _enter(
    n: int, real: NDArray[np.float64], whole: NDArray[np.int32], rows: int, columns: int
) -> None:
    """Find the first cell of each ray within the map; for a ray that misses it, the border.

    A ray from outside is clipped to the map's edges as a line to a box (slab method).
    """
    for i in range(n):
        u, v, t = real[_U, i], real[_V, i], 0.0
        if not (1.0 <= u < columns - 1 and 1.0 <= v < rows - 1):
            near_u = (1.0 if real[_DU, i] >= 0.0 else columns - 1.0) - u
            near_v = (1.0 if real[_DV, i] >= 0.0 else rows - 1.0) - v
            far_u = (columns - 1.0 if real[_DU, i] >= 0.0 else 1.0) - u
            far_v = (rows - 1.0 if real[_DV, i] >= 0.0 else 1.0) - v
            t = max(near_u * real[_PER_U, i], near_v * real[_PER_V, i], 0.0)
            if not t < min(far_u * real[_PER_U, i], far_v * real[_PER_V, i]):
                real[_T, i], whole[_COLUMN, i], whole[_ROW, i] = 0.0, 0, 0
                continue
            u = min(max(u + t * real[_DU, i], 1.0), columns - 1.5)
            v = min(max(v + t * real[_DV, i], 1.0), rows - 1.5)
        real[_T, i], whole[_COLUMN, i], whole[_ROW, i] = t, np.int32(u), np.int32(v)


@compiled
def _jump(n: int, real: NDArray[np.float64], whole: NDArray[np.int32]) -> None:
    """Move each ray to the cell beyond the free square of its cell, if that has a side.

    Without branches, so that the compiler makes vector code of it.
    """
    one, zero = np.int32(1), np.int32(0)
    us, vs, dus, dvs = real[_U], real[_V], real[_DU], real[_DV]
    per_u, per_v, ts = real[_PER_U], real[_PER_V], real[_T]
    columns, rows, sides = whole[_COLUMN], whole[_ROW], whole[_SIDE]
    for i in range(n):
        u, v, du, dv = us[i], vs[i], dus[i], dvs[i]
        column, row, side = columns[i], rows[i], sides[i]
        left, down = du < 0.0, dv < 0.0
        next_column = column - side if left else column + side
        next_row = row - side if down else row + side
        edge_u = next_column + one if left else next_column
        edge_v = next_row + one if down else next_row
        t_u, t_v = (edge_u - u) * per_u[i], (edge_v - v) * per_v[i]
        across_u = t_u <= t_v
        t = t_u if across_u else t_v
        # Rounding must not take the other coordinate out of the square.
        low_column, high_column = edge_u if left else column, column if left else edge_u - one
        low_row, high_row = edge_v if down else row, row if down else edge_v - one
        on_column = min(max(np.int32(u + t * du), low_column), high_column)
        on_row = min(max(np.int32(v + t * dv), low_row), high_row)
        moves = side > zero
        ts[i] = t if moves else ts[i]
        columns[i] = (next_column if across_u else on_column) if moves else column
        rows[i] = (on_row if across_u else next_row) if moves else row


@compiled
def _retire(
    n: int,
    real: NDArray[np.float64],
    whole: NDArray[np.int32],
    plane: NDArray[np.int64],
    rows: int,
    columns: int,
    max_range: float,
    ranges: NDArray[np.float64],
) -> int:
    """Store the rays that have arrived once they are half of the block; return the rest."""
    left = 0
    for i in range(n):
        left += whole[_SIDE, i] > 0 and real[_T, i] < max_range
    if 2 * left > n:
        return n
    kept = 0
    for i in range(n):
        if whole[_SIDE, i] > 0 and real[_T, i] < max_range:
            for q in range(len(real)):
                real[q, kept] = real[q, i]
            for q in range(len(whole)):
                whole[q, kept] = whole[q, i]
            plane[kept] = plane[i]
            kept += 1
            continue
        column, row = whole[_COLUMN, i], whole[_ROW, i]
        outside = column == 0 or row == 0 or column == columns - 1 or row == rows - 1
        t = real[_T, i]
        ranges[whole[_POSE, i]] = np.inf if outside or t >= max_range else t
    return kept
