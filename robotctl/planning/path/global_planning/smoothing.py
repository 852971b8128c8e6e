"""Any-angle paths: straight pieces in place of steps from cell to cell.

A piece may replace the steps between two cells where it costs no more than they do and comes no
nearer to a wall than they come. All cells that it touches count, corners included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled


def straightened(
    points: NDArray[np.float64],
    clearance: NDArray[np.float32],
    prices: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return which points of a path are its corners, indices from the first to the last.

    Parameters
    ----------
    points
        (n, 2) x and y, each in a neighbour of the cell before.
    clearance, prices
        (rows, columns): distance to the nearest wall, and what a unit of length costs; inf where
        the robot cannot be.
    """
    if len(points) < 3:
        return np.arange(len(points))
    cells = np.floor(points[:, ::-1]).astype(np.int64)
    corners: NDArray[np.int64] = _corners(points, cells, clearance, prices)
    return corners


@compiled
def _corners(
    points: NDArray[np.float64],
    cells: NDArray[np.int64],
    clearance: NDArray[np.float32],
    prices: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Go from each corner to the farthest cell that a straight piece may lead to, by halving."""
    count = len(cells)
    spent = np.zeros(count)
    for i in range(1, count):
        length = np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        # Half of a step lies in each of its cells.
        price = prices[cells[i, 0], cells[i, 1]] + prices[cells[i - 1, 0], cells[i - 1, 1]]
        spent[i] = spent[i - 1] + 0.5 * length * price
    corners = [0]
    here = 0
    while here < count - 1:
        reach = 1
        while here + 2 * reach < count and _may(
            points, cells, clearance, prices, spent, here, here + 2 * reach
        ):
            reach *= 2
        there, step = here + reach, reach
        while step > 0:
            if there + step < count and _may(
                points, cells, clearance, prices, spent, here, there + step
            ):
                there += step
            else:
                step //= 2
        corners.append(there)
        here = there
    return np.array(corners)


@compiled
def _may(
    points: NDArray[np.float64],
    cells: NDArray[np.int64],
    clearance: NDArray[np.float32],
    prices: NDArray[np.float64],
    spent: NDArray[np.float64],
    here: int,
    there: int,
) -> bool:
    """Return whether the straight piece between two cells costs no more and is no nearer."""
    least = np.inf
    for i in range(here, there + 1):
        least = min(least, clearance[cells[i, 0], cells[i, 1]])
    cost, near = line(
        clearance, prices, points[here, 0], points[here, 1], points[there, 0], points[there, 1]
    )
    return near >= least and cost <= spent[there] - spent[here] + 1e-9


@compiled
def line(
    clearance: NDArray[np.float32] | NDArray[np.float64],
    prices: NDArray[np.float64],
    x0: float,
    y0: float,
    x1: float,
    y1: float,
) -> tuple[float, float]:
    """Return the cost of a straight piece and the least clearance of the cells that it touches.

    Cells are visited in order (Amanatides and Woo 1987); where it passes a corner exactly, both
    cells beside the corner count for the clearance.
    """
    rows, columns = clearance.shape
    dx, dy = x1 - x0, y1 - y0
    length = np.hypot(dx, dy)
    column, row = int(np.floor(x0)), int(np.floor(y0))
    last_column, last_row = int(np.floor(x1)), int(np.floor(y1))
    right, up = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = (column + (dx > 0) - x0) / dx if dx != 0.0 else np.inf
    next_y = (row + (dy > 0) - y0) / dy if dy != 0.0 else np.inf
    step_x = abs(1.0 / dx) if dx != 0.0 else np.inf
    step_y = abs(1.0 / dy) if dy != 0.0 else np.inf
    done, cost, near = 0.0, 0.0, np.inf
    while True:
        if not (0 <= row < rows and 0 <= column < columns):
            return np.inf, -0.5
        near = min(near, clearance[row, column])
        until = min(next_x, next_y, 1.0)
        cost += (until - done) * length * prices[row, column]
        done = until
        if done >= 1.0 or (row == last_row and column == last_column):
            return cost, near
        if abs(next_x - next_y) < 1e-12:
            if 0 <= column + right < columns:
                near = min(near, clearance[row, column + right])
            if 0 <= row + up < rows:
                near = min(near, clearance[row + up, column])
            column += right
            row += up
            next_x += step_x
            next_y += step_y
        elif next_x < next_y:
            column += right
            next_x += step_x
        else:
            row += up
            next_y += step_y
