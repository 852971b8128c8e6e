"""How far a sonar measures on an occupancy grid: a fan of rays across its cone.

The echo comes from the nearest cell that a ray of the fan meets below the incidence limit, from
half a cell behind its edge, where surfaces lie on the average. The
direction of a surface at a cell is that of the structure tensor of the cells around it (Bigun and
Granlund 1987): the axis along which the smoothed map changes most. Where it has none, as at corners
and pillars, the cell sends sound back in all directions.
"""

from __future__ import annotations

import copy
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from native_kernels.compiled import compiled
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.model.grid_map import GridMap

_RAYS: Final = 9
"""Rays of the fan: 3 degrees apart in a cone of 25, 0.2 m at 4 m."""
_EDGE_CELLS: Final = 1.0
_AROUND_CELLS: Final = 2.0
"""Smoothing of the map before it is differentiated, and of the tensor."""
_DIRECTED: Final = 0.5
"""Coherence of the tensor, 0 to 1, from which on a surface has a direction."""
_INTO_CELL: Final = 1e-6
"""Depth behind the edge of a cell at which its normal is looked up [cells]: rounding."""


class GridEchoes:
    """Ranges of a ring of sonars on an occupancy grid.

    Parameters
    ----------
    grid
        The map; unknown cells count as free.
    cones
        The sonars.
    """

    def __init__(self, grid: GridMap, cones: SonarCones) -> None:
        self._mounts = cones.mounts
        self._caster = RangeCaster(grid)
        self._grid = grid
        self._normals = surface_normals(grid.occupied())
        self._fan = np.linspace(-0.5 * cones.beam_rad, 0.5 * cones.beam_rad, _RAYS)
        self._cos_limit = math.cos(cones.max_incidence_rad)
        self._max_range_m = cones.max_range_m

    def with_limit(self, max_incidence_rad: float) -> GridEchoes:
        """Return the same sonars with another incidence limit, in (0, pi/2) [rad]."""
        other = copy.copy(self)
        other._cos_limit = math.cos(max_incidence_rad)
        return other

    def ranges(self, poses: NDArray[np.float64], sonars: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return what sonars should measure at poses, see `Echoes.ranges`."""
        mounts = self._mounts[sonars]
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x = poses[:, :1] + c * mounts[:, 0] - s * mounts[:, 1]
        y = poses[:, 1:2] + s * mounts[:, 0] + c * mounts[:, 1]
        at = np.stack([x, y, poses[:, 2:] + mounts[:, 2]], axis=2).reshape(-1, 3)
        rays = self._caster.cast(at, self._fan, self._max_range_m)
        origin = self._grid.origin
        on_map = at - [origin.x_m, origin.y_m, origin.theta_rad]
        c0, s0 = math.cos(origin.theta_rad), math.sin(origin.theta_rad)
        on_map[:, :2] = on_map[:, :2] @ np.array([[c0, -s0], [s0, c0]])
        found = np.empty(len(at))
        _nearest_reflecting(
            rays, on_map, self._fan, self._normals, self._grid.resolution_m, self._cos_limit, found
        )
        return (found + 0.5 * self._grid.resolution_m).reshape(len(poses), len(mounts))


def surface_normals(occupied: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the normal of the surface at each cell, (rows, columns, 2): along columns, rows.

    A unit vector, either way; 0 if the surface has no direction.
    """
    smooth = ndimage.gaussian_filter(occupied.astype(np.float32), _EDGE_CELLS)
    along_rows, along_columns = np.gradient(smooth)
    xx = ndimage.gaussian_filter(along_columns * along_columns, _AROUND_CELLS)
    yy = ndimage.gaussian_filter(along_rows * along_rows, _AROUND_CELLS)
    xy = ndimage.gaussian_filter(along_columns * along_rows, _AROUND_CELLS)
    direction = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    directed = np.hypot(xx - yy, 2.0 * xy) > _DIRECTED * (xx + yy)
    normals = np.stack([np.cos(direction), np.sin(direction)], axis=2)
    normals[~directed] = 0.0
    return normals.astype(np.float32)


@compiled
def _nearest_reflecting(
    rays: NDArray[np.float64],
    sonars: NDArray[np.float64],
    fan: NDArray[np.float64],
    normals: NDArray[np.float32],
    resolution: float,
    cos_limit: float,
    found: NDArray[np.float64],
) -> None:
    """Fill `found` (n,) with the least of the rays (k, n) that meet no surface too flatly."""
    rows, columns = normals.shape[0], normals.shape[1]
    for i in range(len(found)):
        best = np.inf
        for k in range(len(fan)):
            r = rays[k, i]
            if not r < best:
                continue
            c, s = math.cos(sonars[i, 2] + fan[k]), math.sin(sonars[i, 2] + fan[k])
            deep = r + _INTO_CELL
            column = min(max(int((sonars[i, 0] + deep * c) / resolution), 0), columns - 1)
            row = min(max(int((sonars[i, 1] + deep * s) / resolution), 0), rows - 1)
            nx, ny = normals[row, column]
            if abs(c * nx + s * ny) >= cos_limit or (nx == 0.0 and ny == 0.0):
                best = r
        found[i] = best
