"""View of a pilot for people: its plan, and what it sees around the robot."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap

NOWHERE: Final = np.empty((0, 3))


class Outlook(NamedTuple):
    """All of it is in `world`."""

    path: NDArray[np.float64]
    """(n, 3) poses of `base`, the rest of the planned path [m, m, rad]; n = 0: it drives by none.
    """
    arc: NDArray[np.float64]
    """(m, 3) poses of `base` that the present velocity leads through [m, m, rad]."""
    obstacles: NDArray[np.float64]
    """(k, 2) what the sensors have seen that is not on the map [m]."""
    moving: NDArray[np.float64]
    """Moving things, (j, 5), as `LocalSituation.moving`."""
    costs: GridMap
    """Cost of each place around the robot for the middle of its body: see `costs_of`."""
