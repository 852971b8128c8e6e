"""Zones of the world that a robot keeps out of, or passes slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import InvalidValue
from robotctl.model.grid_map import GridMap

Point: TypeAlias = tuple[float, float]

FASTEST_M_S = 100.0
MOST_CORNERS = 1000


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon in `world` with its own speed limit.

    Parameters
    ----------
    name
        For people.
    corners
        In either order [m], 3 to 1000.
    speed_m_s
        The largest speed inside [m/s], 0 to 100; 0: the robot keeps out.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    name: str
    corners: tuple[Point, ...]
    speed_m_s: float = 0.0

    def __post_init__(self) -> None:
        if not 3 <= len(self.corners) <= MOST_CORNERS:
            raise InvalidValue(
                "corners", f"{len(self.corners)} found, 3 to {MOST_CORNERS} allowed", self.corners
            )
        if not all(math.isfinite(x_m) and math.isfinite(y_m) for x_m, y_m in self.corners):
            raise InvalidValue("corners", f"must be finite, found {self.corners}", self.corners)
        if not 0.0 <= self.speed_m_s <= FASTEST_M_S:
            raise InvalidValue(
                "speed_m_s",
                f"{self.speed_m_s} found, 0 to {FASTEST_M_S:g} allowed",
                self.speed_m_s,
            )


def cells_of(zone: Zone, grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map have their centre in a zone, (rows, columns).

    A point is inside if a line from it crosses the sides an odd number of times.
    """
    inside = np.zeros(grid.shape, np.bool_)
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)
    away = (np.array(zone.corners) - (grid.origin.x_m, grid.origin.y_m)) / grid.resolution_m
    corners = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        rows = np.arange(
            max(math.ceil(min(ay, by) - 0.5), 0),
            min(math.ceil(max(ay, by) - 0.5), grid.shape[0]),
        )
        if len(rows):
            crossing = ax + (rows + 0.5 - ay) / (by - ay) * (bx - ax)
            inside[rows] ^= np.arange(grid.shape[1]) + 0.5 > crossing[:, np.newaxis]
    return inside
