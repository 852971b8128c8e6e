"""Maps as messages and back."""

from __future__ import annotations

import numpy as np

from robotctl.messages.estimation import LiveMap
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap


def map_message(grid: GridMap, stamp_ns: int) -> LiveMap:
    """Return a map as a message."""
    rows, columns = grid.shape
    origin = grid.origin
    return LiveMap(
        stamp_ns=stamp_ns,
        rows=rows,
        columns=columns,
        resolution_m=grid.resolution_m,
        x_m=origin.x_m,
        y_m=origin.y_m,
        cells=grid.cells.tobytes(),
        theta_rad=origin.theta_rad,
    )


def grid_of(message: LiveMap) -> GridMap:
    """Return a message as a map."""
    cells = np.frombuffer(message.cells, np.int8).reshape(message.rows, message.columns)
    return GridMap(cells, message.resolution_m, SE2(message.x_m, message.y_m, message.theta_rad))
