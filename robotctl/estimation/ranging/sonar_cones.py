"""A ring of sonars as the geometry of echoes sees it, in a room of walls or of cells."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class SonarCones(NamedTuple):
    """Cones of a ring of sonars, and which echoes come back to them."""

    mounts: NDArray[np.float64]
    """The sonars in `base`, (k, 3): x, y, direction of the axis [m, m, rad]."""
    beam_rad: float
    """Opening of a cone, from edge to edge, in (0, pi) [rad]."""
    max_incidence_rad: float
    """Greatest angle between sound and a surface's normal, in (0, pi/2) [rad]."""
    max_range_m: float
    """Maximum range of an echo [m]."""


class Echoes(Protocol):
    """Ranges of a ring of sonars in a known room."""

    def with_limit(self, max_incidence_rad: float) -> Echoes:
        """Return the same sonars with another incidence limit, in (0, pi/2) [rad]."""

    def ranges(self, poses: NDArray[np.float64], sonars: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return what some of the sonars should measure from each pose.

        Parameters
        ----------
        poses
            Poses of `base` in `world`, (n, 3) [m, m, rad].
        sonars
            Their numbers, (k,).

        Returns
        -------
        NDArray
            (n, k) [m]; inf if nothing sends an echo.
        """
