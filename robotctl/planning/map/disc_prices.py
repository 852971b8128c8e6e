"""Discs of floor in which a path costs more."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def raise_in_disc(
    prices: NDArray[np.float32], x: float, y: float, radius: float, price: float
) -> None:
    """Make cells whose middles lie in a disc at least so dear.

    Parameters
    ----------
    prices
        (rows, columns); changed.
    x, y, radius
        The disc in the map's frame [cells].
    price
        How many times longer a path counts there.
    """
    first_row, first_column = (max(math.floor(at - radius), 0) for at in (y, x))
    window = prices[
        first_row : max(math.ceil(y + radius), 0), first_column : max(math.ceil(x + radius), 0)
    ]
    rows, columns = np.ogrid[: window.shape[0], : window.shape[1]]
    inside = np.hypot(rows + first_row + 0.5 - y, columns + first_column + 0.5 - x) <= radius
    np.maximum(window, np.float32(price), out=window, where=inside)
