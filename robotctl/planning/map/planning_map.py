"""A map as planners see it: how far each cell is from what a robot must not touch.

All of it is in the map's own frame with lengths in cells: row and column 0 begin at the map's
corner, and the point (x, y) lies in cell (floor(y), floor(x)). `to_cells` and `to_world` convert.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from native_kernels.compiled import borrows, compiled
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import discs, samples
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.discs import EDGE
from robotctl.planning.map.zones import Closed

APART: float = 0.93
"""A point is up to 0.71 from the centre of its cell, and a corner up to 0.21 nearer than the
clearance says [cells]."""


class PlanningMap:
    """A map, what of it is blocked, and the robot that must pass.

    Parameters
    ----------
    grid
        The map. Everything beyond it counts as blocked.
    footprint
        Of the robot.
    through_unknown
        Whether the robot may pass where the map knows nothing.
    occupied_percent
        Cells are obstacles from this probability on [%].
    """

    def __init__(
        self,
        grid: GridMap,
        footprint: Footprint,
        *,
        through_unknown: bool = False,
        occupied_percent: int = 50,
    ) -> None:
        self.grid = grid
        self.footprint = footprint
        self.through_unknown = through_unknown
        self.obstacle = grid.occupied(occupied_percent)
        self.blocked = self.obstacle if through_unknown else self.obstacle | (grid.cells < 0)
        self.clearance = clearance_of(self.blocked)
        """Distance of each cell's centre from the nearest edge of a blocked one [cells], (rows,
        columns); up to 0.21 more than it is where that is a corner. A live map does not look
        farther than a metre beyond the robot's circle: there it says that much."""
        self.slowness: NDArray[np.float32] | None = None
        """How many times longer a path counts, (rows, columns); None: nowhere more than once."""
        self.closed = Closed()
        """Zones and fence among the obstacles of `grid`; reasons name them."""
        self.samples = samples(footprint, 0.5 * grid.resolution_m) / grid.resolution_m
        self.discs = discs(footprint) / grid.resolution_m
        self.inscribed = footprint.inscribed_m / grid.resolution_m
        self.circumscribed = footprint.reach_m / grid.resolution_m

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.grid.shape

    def window(self, first: tuple[int, int], last: tuple[int, int]) -> PlanningMap:
        """Return a copy of a part: from a cell to another, row and column, both included."""
        part = copy.copy(self)
        cells = slice(first[0], last[0] + 1), slice(first[1], last[1] + 1)
        side_m = self.grid.resolution_m
        origin = self.grid.origin @ SE2(first[1] * side_m, first[0] * side_m, 0.0)
        part.grid = GridMap(self.grid.cells[cells].copy(), side_m, origin)
        part.obstacle, part.blocked = self.obstacle[cells].copy(), self.blocked[cells].copy()
        part.clearance = self.clearance[cells].copy()
        if self.slowness is not None:
            part.slowness = self.slowness[cells].copy()
        return part

    def zone_prices(self) -> NDArray[np.float32]:
        """Return how many times longer a path counts in each cell, (rows, columns), at least 1."""
        return np.ones(self.shape, np.float32) if self.slowness is None else self.slowness

    def to_cells(self, pose: SE2) -> SE2:
        """Return a pose of `world` in the map's frame, in cells."""
        local = self.grid.origin.inverse() @ pose
        side_m = self.grid.resolution_m
        return SE2(local.x_m / side_m, local.y_m / side_m, local.theta_rad)

    def poses_to_cells(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses of `world` (n, 3) [m, m, rad] in the map's frame, in cells."""
        origin = self.grid.origin
        c, s = math.cos(origin.theta_rad), math.sin(origin.theta_rad)
        away = (poses[:, :2] - (origin.x_m, origin.y_m)) / self.grid.resolution_m
        places = away @ np.array([[c, -s], [s, c]])
        return np.column_stack([places, poses[:, 2] - origin.theta_rad])

    def to_world(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses of the map's frame (n, 3) [cells, cells, rad] in `world`."""
        origin, side_m = self.grid.origin, self.grid.resolution_m
        c, s = math.cos(origin.theta_rad), math.sin(origin.theta_rad)
        x, y = poses[:, 0] * side_m, poses[:, 1] * side_m
        angles = np.arctan2(
            np.sin(poses[:, 2] + origin.theta_rad), np.cos(poses[:, 2] + origin.theta_rad)
        )
        return np.stack([origin.x_m + c * x - s * y, origin.y_m + s * x + c * y, angles], axis=1)

    def contains(self, x: float, y: float) -> bool:
        """Return whether a point lies on the map."""
        rows, columns = self.shape
        return 0 <= math.floor(y) < rows and 0 <= math.floor(x) < columns

    def collides(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return for each pose (n, 3) [cells, cells, rad] whether the body is in a blocked cell."""
        hits: NDArray[np.bool_] = _collide(
            self.blocked, self.clearance, self.samples, self.discs, poses
        )
        return hits

    def has_room_at(self, pose: SE2) -> bool:
        """Return whether the body touches nothing at a pose of `world`."""
        here = self.to_cells(pose)
        return not self.collides(np.array([[here.x_m, here.y_m, here.theta_rad]]))[0]

    def can_turn_at(self, pose: SE2, margin_m: float) -> bool:
        """Return whether the body can turn on the spot, with a margin, at a pose on the map."""
        here = self.to_cells(pose)
        needed = self.circumscribed + margin_m / self.grid.resolution_m
        return bool(self.clearance[math.floor(here.y_m), math.floor(here.x_m)] > needed)

    def gaps_m(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of the body from blocked cells, for poses (n, 3) in cells, (n,) [m].

        It is right to about a cell; 0 if they touch.
        """
        gaps: NDArray[np.float64] = _gaps(self.clearance, self.samples, poses)
        return np.maximum(gaps, 0.0) * self.grid.resolution_m


def clearance_of(blocked: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return how far each cell's centre is from blocked cells and the map's edge [cells].

    0.5 less than the Euclidean distance between the centres; -0.5 in a blocked cell.
    """
    padded = np.pad(blocked, 1, constant_values=True)
    distance = ndimage.distance_transform_edt(~padded)[1:-1, 1:-1]
    clearance: NDArray[np.float32] = (distance - EDGE).astype(np.float32)
    return clearance


@compiled
def _collide(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    samples: NDArray[np.float64],
    discs: NDArray[np.float64],
    poses: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Look at each point of the body, unless nothing is near."""
    result = np.zeros(len(poses), np.bool_)
    for i in range(len(poses)):
        result[i] = body_hits(
            blocked, clearance, samples, discs, poses[i, 0], poses[i, 1], poses[i, 2]
        )
    return result


@compiled
@borrows
def body_hits(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    samples: NDArray[np.float64],
    discs: NDArray[np.float64],
    x: float,
    y: float,
    theta: float,
) -> bool:
    """Return whether a point of the body at a pose lies in a blocked cell or off the map."""
    rows, columns = blocked.shape
    c, s = np.cos(theta), np.sin(theta)
    is_far = True
    for k in range(len(discs)):  # they cover the body: where nothing is near, it is free
        px, py = discs[k, 0], discs[k, 1]
        row, column = int(np.floor(y + s * px + c * py)), int(np.floor(x + c * px - s * py))
        inside = 0 <= row < rows and 0 <= column < columns
        if not inside or clearance[row, column] < discs[k, 2] + APART:
            is_far = False
            break
    if is_far:
        return False
    for k in range(len(samples)):
        px, py = samples[k, 0], samples[k, 1]
        r = int(np.floor(y + s * px + c * py))
        q = int(np.floor(x + c * px - s * py))
        if not (0 <= r < rows and 0 <= q < columns) or blocked[r, q]:
            return True
    return False


@compiled
def _gaps(
    clearance: NDArray[np.float32], samples: NDArray[np.float64], poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the smallest clearance of the cells that the body covers at each pose."""
    rows, columns = clearance.shape
    result = np.empty(len(poses))
    for i in range(len(poses)):
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        least = np.inf
        for k in range(len(samples)):
            px, py = samples[k, 0], samples[k, 1]
            r = int(np.floor(poses[i, 1] + s * px + c * py))
            q = int(np.floor(poses[i, 0] + c * px - s * py))
            inside = 0 <= r < rows and 0 <= q < columns
            least = min(least, clearance[r, q] if inside else -0.5)
        result[i] = least
    return result
