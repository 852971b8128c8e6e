"""Closed path of a walker."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from firmware_sim.world.walking.walker import Place


class ClosedPath:
    """Straight lines over corners, (k, 2) [m], of which the first comes again at the end."""

    __slots__ = ("_corners", "_lengths_m")

    def __init__(self, corners: np.ndarray) -> None:
        lengths_m = np.hypot(*np.diff(corners, axis=0).T).cumsum()
        self._lengths_m: list[float] = [0.0, *lengths_m.tolist()]
        self._corners: list[Place] = [(x, y) for x, y in corners.tolist()]

    def along(self, at_m: float) -> Place:
        """Return the place at a distance along the path [m], of any sign and size."""
        lengths_m = self._lengths_m
        whole_m = lengths_m[-1]
        at_m = at_m % whole_m % whole_m  # twice: -1e-20 % 5.0 is 5.0
        after = bisect_right(lengths_m, at_m)
        side_m, into_m = lengths_m[after] - lengths_m[after - 1], at_m - lengths_m[after - 1]
        (x, y), (next_x, next_y) = self._corners[after - 1], self._corners[after]
        return (next_x - x) / side_m * into_m + x, (next_y - y) / side_m * into_m + y

    def passes_last(self, from_m: float, to_m: float) -> bool:
        """Return whether the last corner lies between two distances along the path [m]."""
        last_m, whole_m = self._lengths_m[-2:]
        return (from_m - last_m) // whole_m != (to_m - last_m) // whole_m
