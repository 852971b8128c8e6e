"""A map of walls as line segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class WallMap:
    """Walls from A to B in world; both sides reflect.

    Parameters
    ----------
    segments
        A x, A y, B x, B y of each wall, (n, 4) [m].

    Raises
    ------
    ValueError
        If the array is not (n, 4) with n > 0, not finite, or a wall has no length.
    """

    segments: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.segments.ndim != 2 or self.segments.shape[1] != 4 or len(self.segments) == 0:
            raise ValueError(f"segments must be (n, 4), n > 0, found {self.segments.shape}")
        if not np.all(np.isfinite(self.segments)):
            raise ValueError("segments must be finite")
        if np.any(np.all(self.segments[:, :2] == self.segments[:, 2:], axis=1)):
            raise ValueError("segments: a wall without length")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Min x, min y, max x, max y of all walls [m]."""
        points = self.segments.reshape(-1, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])
