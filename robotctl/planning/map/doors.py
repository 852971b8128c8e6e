"""Doors of a map, which a robot leaves free for people."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap
from robotctl.planning.map.discs import Disc, raise_in_disc
from robotctl.planning.map.topological.build import LEAST_AREA_M2, open_depth_m
from robotctl.planning.map.topological.regions import DOOR_M, NECK, floor_regions

_TILE_M: Final = 2.0
"""Side of the tiles that are searched for doors, and width of the margin round each [m]."""
RADIUS_M: Final = 0.5
"""Radius of the disc of floor that belongs to a door [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Doors:
    """Doors of a map, and the price of each.

    Parameters
    ----------
    places
        Middles of the doors in `world`, (n, 2) [m].
    price_m
        Extra length of a path that a door counts as [m].
    """

    places: NDArray[np.float64]
    price_m: float

    def prices(self, grid: GridMap) -> NDArray[np.float32] | None:
        """Return the price of each cell, (rows, columns), at least 1; None: there are no doors.

        A path straight through a door crosses its disc along a diameter.
        """
        if not len(self.places):
            return None
        prices = np.ones(grid.shape, np.float32)
        price = 1.0 + self.price_m / (2.0 * RADIUS_M)
        for row, column in grid.cell_of(self.places).tolist():
            raise_in_disc(
                prices, Disc(column + 0.5, row + 0.5, RADIUS_M / grid.resolution_m), price
            )
        return prices

    def away_m(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far places (m, 2) of `world` are from the nearest door [m]; inf: none."""
        away_m = np.full(len(places), np.inf)
        for door in self.places:
            np.minimum(away_m, np.hypot(*(places - door).T), out=away_m)
        return away_m


NO_DOORS: Final = Doors(np.empty((0, 2)), 0.0)


def doors_of(grid: GridMap | None, radius_m: float, price_m: float) -> Doors:
    """Return the doors of a map: passages clearly narrower than the floor on both sides.

    Only the floor nearby counts, so that a door is found even where a wide way leads round it.

    Parameters
    ----------
    grid
        The map; None: the robot has none, and knows no doors.
    radius_m
        Radius of the circle inscribed in the robot [m]; narrower passages do not count.
    price_m
        Price of a door, see `Doors`. At 0 none are searched for, which would take seconds on a
        large map.
    """
    if grid is None or price_m == 0.0:
        return NO_DOORS
    depth_m = open_depth_m(grid)
    tile = math.ceil(_TILE_M / grid.resolution_m)
    found = [
        corner + cell
        for corner in np.argwhere(np.ones(-(-np.array(grid.shape) // tile))) * tile
        for cell in _doors_in(depth_m, corner.tolist(), tile, radius_m, grid.resolution_m)
    ]
    places = grid.centre_of(np.array(found).reshape(-1, 2))
    first = [
        number
        for number, place in enumerate(places)
        if not (np.hypot(*(places[:number] - place).T) < RADIUS_M).any()
    ]
    return Doors(places[first], price_m)


def _doors_in(
    depth_m: NDArray[np.float64], corner: list[int], tile: int, radius_m: float, side_m: float
) -> list[NDArray[np.int64]]:
    """Return the middles of the doors in a tile, as rows and columns from its corner."""
    begin = [max(at - tile, 0) for at in corner]
    window = depth_m[begin[0] : corner[0] + 2 * tile, begin[1] : corner[1] + 2 * tile]
    if not _has_neck(window, radius_m):
        return []
    regions = floor_regions(window, radius_m)
    sizes_m2 = np.bincount(regions.ravel() + 1) * side_m**2
    large = (regions >= 0) & (sizes_m2[regions + 1] >= LEAST_AREA_M2)
    border = np.zeros(window.shape, np.bool_)
    for one, other in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        border[one] |= large[one] & large[other] & (regions[one] != regions[other])
    parts, count = ndimage.label(ndimage.binary_dilation(border, np.ones((3, 3))))
    doors = []
    for part in range(1, count + 1):
        widths_m = 2.0 * np.where(border & (parts == part), window, 0.0)
        middle = np.array(np.unravel_index(np.argmax(widths_m), window.shape))
        inside = middle + begin - corner
        if widths_m.max() <= DOOR_M and (inside >= 0).all() and (inside < tile).all():
            doors.append(inside)
    return doors


def _has_neck(depth_m: NDArray[np.float64], radius_m: float) -> bool:
    """Return whether the floor may have a neck: a quick check that most of a hall fails."""
    level_m = radius_m / NECK
    while level_m * NECK <= 0.5 * DOOR_M:
        # Floor of at least this depth falls apart at a neck, but not within a hall.
        if ndimage.label(depth_m >= level_m, np.ones((3, 3)))[1] > 1:
            return True
        level_m /= NECK
    return False
