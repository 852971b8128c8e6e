"""A room of square cells, like a robot's map: walls, corners and free space.

The walls are the exact sides of occupied cells that face another cell; collinear sides are merged,
so that a long wall costs no more than one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

ROOM_M = 0.4
"""Clearance of a free line [m]: a little more than half a robot's width."""
_LONGEST_M = 8.0
_DIRECTIONS = 72


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells that are walls, and cells where a robot can be.

    Attributes
    ----------
    occupied, free
        Masks, (rows, columns) bool; all other cells are unknown: no walls, but no robot is placed
        there. Row 0 is the lowest.
    side_m
        Side of a cell.
    origin
        Lower left corner of cell (0, 0) in world, x, y [m], and the direction of its row [rad].
    """

    occupied: np.ndarray
    free: np.ndarray
    side_m: float
    origin: tuple[float, float, float]

    def walls(self) -> np.ndarray:
        """Sides between occupied cells and others, merged, (n, 4): from x, y to x, y [m]."""
        padded = np.pad(self.occupied, 1).astype(np.int8)
        level = _runs(np.diff(padded, axis=0)[:, 1:-1])
        upright = _runs(np.diff(padded, axis=1)[1:-1].T)
        lines = np.vstack([level, upright[:, [1, 0, 3, 2]]])
        return np.ascontiguousarray(self._to_world(lines.reshape(-1, 2)).reshape(-1, 4))

    def corners(self) -> np.ndarray:
        """Corners that a cell has between two walls, as `World.corners`, (m, 6)."""
        padded = np.pad(self.occupied, 1)
        found = [np.empty((0, 6))]
        c, s = math.cos(self.origin[2]), math.sin(self.origin[2])
        turn = np.array([[c, s], [-s, c]])
        for right in (False, True):
            for up in (False, True):
                # The cell looks from its corner to this side, along both of its neighbours.
                here = _quarter(padded, right=right, up=up)
                beside = _quarter(padded, right=not right, up=up)
                below = _quarter(padded, right=right, up=not up)
                rows, columns = np.nonzero(~here & beside & below)
                arms = np.array([[1.0 if right else -1.0, 0.0], [0.0, 1.0 if up else -1.0]]) @ turn
                places = self._to_world(np.column_stack([columns, rows]).astype(np.float64))
                found.append(np.hstack([places, np.tile(arms.ravel(), (len(rows), 1))]))
        return np.ascontiguousarray(np.vstack(found))

    def bounds(self) -> tuple[float, float, float, float]:
        """Min x, min y, max x, max y [m] of the free cells; there must be one."""
        rows, columns = (np.flatnonzero(self.free.any(axis=axis)) for axis in (1, 0))
        corners = [(x, y) for x in columns[[0, -1]] + [0, 1] for y in rows[[0, -1]] + [0, 1]]
        points = self._to_world(np.array(corners, dtype=np.float64))
        (low_x, low_y), (high_x, high_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return low_x, low_y, high_x, high_y

    def is_occupied(self, points: np.ndarray) -> np.ndarray:
        """Whether each point, (n, 2) [m], is in an occupied cell, (n,)."""
        return self._at(self.occupied, points)

    def is_free(self, points: np.ndarray) -> np.ndarray:
        """Whether each point, (n, 2) [m], lies in a free cell, (n,)."""
        return self._at(self.free, points)

    def clear_way(self) -> tuple[float, float, float, float]:
        """Return x, y [m], heading [rad] and length [m] of a straight line from the roomiest place.

        The heading is the one with the longest line, up to 8 m, that keeps `ROOM_M` from everything
        not free; the length is 0 if the place has less room. There must be a free cell.
        """
        from scipy import ndimage  # type: ignore[import-untyped] # noqa: PLC0415 - it takes 0.1 s

        # At least the distance from a cell's middle to the nearest side of one that is not free.
        room_m = (ndimage.distance_transform_edt(np.pad(self.free, 1)) - 0.75) * self.side_m
        row, column = np.unravel_index(np.argmax(room_m), room_m.shape)
        headings = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
        along = np.arange(0.0, _LONGEST_M / self.side_m)[:, None]
        columns = np.clip(np.rint(column + along * np.cos(headings)), 0, room_m.shape[1] - 1)
        rows = np.clip(np.rint(row + along * np.sin(headings)), 0, room_m.shape[0] - 1)
        is_clear = room_m[rows.astype(np.intp), columns.astype(np.intp)] >= ROOM_M
        steps = np.logical_and.accumulate(is_clear, axis=0).sum(axis=0)
        best = int(np.argmax(steps))
        ((x_m, y_m),) = self._to_world(np.array([[column - 0.5, row - 0.5]])).tolist()
        heading = math.remainder(headings[best] + self.origin[2], 2.0 * math.pi)
        return x_m, y_m, heading, max(int(steps[best]) - 1, 0) * self.side_m

    def _to_world(self, points: np.ndarray) -> np.ndarray:
        """Return points in cells (column, row), (n, 2), as x, y in world [m]."""
        x, y, theta = self.origin
        c, s = math.cos(theta), math.sin(theta)
        placed: np.ndarray = (points * self.side_m) @ np.array([[c, s], [-s, c]]) + (x, y)
        return placed

    def _at(self, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the values of cells at points in world, (n,); False outside."""
        x, y, theta = self.origin
        c, s = math.cos(theta), math.sin(theta)
        along = (points - (x, y)) @ np.array([[c, -s], [s, c]]) / self.side_m
        column, row = np.floor(along).astype(np.int64).T
        inside = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
        return np.where(inside, cells[row * inside, column * inside], False)


def _runs(steps: np.ndarray) -> np.ndarray:
    """Return runs of equal steps, not 0, in the rows, (n, 4): from column, row to column, row."""
    padded = np.pad(steps, ((0, 0), (1, 1)))
    changes = padded[:, 1:] != padded[:, :-1]
    rows, first = np.nonzero(changes & (padded[:, 1:] != 0))
    _, last = np.nonzero(changes & (padded[:, :-1] != 0))
    return np.column_stack([first, rows, last, rows]).astype(np.float64)


def _quarter(padded: np.ndarray, *, right: bool, up: bool) -> np.ndarray:
    """Return one of the four cells around each corner of cells, (rows + 1, columns + 1)."""
    rows, columns = padded.shape
    return padded[int(up) : rows - 1 + up, int(right) : columns - 1 + right]
