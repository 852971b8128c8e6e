"""Discs of floor in which a path costs more, or that are closed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EDGE: float = 0.5
"""Distance from a cell's centre to its edge [cells], by which a wall beside it is nearer."""


class Disc(NamedTuple):
    """Disc in a map's own frame."""

    x: float
    y: float
    """Coordinates of its middle [cells]."""
    radius: float
    """Radius [cells]."""


def raise_in_disc(prices: NDArray[np.float32], disc: Disc, price: float) -> None:
    """Raise the price of all cells whose middles lie in a disc to at least a value.

    Parameters
    ----------
    prices
        Prices of all cells, (rows, columns); changed.
    disc
        Disc to price.
    price
        Length that a metre there counts as [m].
    """
    window = prices[cells_around(disc)]
    np.maximum(window, np.float32(price), out=window, where=_away(disc, 0.0, window.shape) <= 0.0)


def close_disc(
    blocked: NDArray[np.bool_], clearance: NDArray[np.float32], disc: Disc, reach: float
) -> None:
    """Block cells whose middles lie in a disc.

    Parameters
    ----------
    blocked, clearance
        (rows, columns) as of `PlanningMap`; changed.
    disc
        Disc to close.
    reach
        Distance from the disc up to which the clearance is updated [cells].
    """
    around = cells_around(disc, reach)
    away = _away(disc, reach, blocked[around].shape)
    blocked[around] |= away <= 0.0
    np.minimum(clearance[around], np.maximum(away - EDGE, -EDGE), out=clearance[around])


def cells_around(disc: Disc, reach: float = 0.0) -> tuple[slice, slice]:
    """Return the rows and columns of the square round a disc and a margin [cells]."""
    far = disc.radius + reach
    rows, columns = (
        slice(max(math.floor(at - far), 0), max(math.ceil(at + far), 0)) for at in (disc.y, disc.x)
    )
    return rows, columns


def _away(disc: Disc, reach: float, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return the distances of the middles of these cells from a disc [cells]; < 0: inside."""
    rows, columns = cells_around(disc, reach)
    down, right = np.ogrid[: shape[0], : shape[1]]
    middle_y, middle_x = down + rows.start + 0.5, right + columns.start + 0.5
    away: NDArray[np.float32] = np.hypot(middle_y - disc.y, middle_x - disc.x) - disc.radius
    return away.astype(np.float32)
