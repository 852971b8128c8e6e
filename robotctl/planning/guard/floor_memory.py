"""Camera obstacles near the robot, kept while out of sight.

A camera that looks ahead loses close obstacles: one that the robot stops for is often just below
the picture. So points are kept in the frame of the odometry until the camera sees floor there, or
the robot is far away. One picture may err: a point counts when two in a row have it. If the points
are lost, the floor below the picture is unknown and counts as blocked until it is seen.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.guard.course import Point

_REACH_M: Final = 1.5
"""Points further away are ignored [m]."""
_SIGMA_M: Final = 0.1
"""Maximum standard deviation of a range that locates an object [m]."""
_SAME_M: Final = 0.1
"""Distance within which points of two pictures are one object; extra range of a beam that proves
floor."""
_CELL_M: Final = 0.05
"""Points are kept once for each square of this side."""


class FloorView(NamedTuple):
    """The ends of the floor in the camera's view."""

    x_m: float
    """The camera in `base` [m]."""
    y_m: float
    angles_rad: NDArray[np.float64]
    """Beams, (n,), counter-clockwise from forward."""
    ranges_m: NDArray[np.float64]
    """(n,) [m]; inf: floor up to the maximum range; nan: not judged."""
    sigmas_m: NDArray[np.float64]
    """Their standard deviations, (n,) [m]."""
    nearest_m: NDArray[np.float64]
    """Floor nearer than this is below the picture, (n,) [m]."""
    trusted: bool = True
    """If not, it shows possible obstacles, but proves no free floor."""


class FloorMemory:
    """Points around the robot that it must not drive over."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._points = np.empty((0, 2))
        self._last = np.empty((0, 2))
        """Points of the last view, confirmed or not."""

    def see(self, T_odom_base: SE2, view: FloorView) -> None:
        """Add a view, taken at a pose in the frame of the odometry."""
        camera = T_odom_base @ SE2(view.x_m, view.y_m, 0.0)
        hit = (view.ranges_m <= _REACH_M) & (view.sigmas_m <= _SIGMA_M)
        angles = view.angles_rad[hit] + camera.theta_rad
        ahead = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        new = [camera.x_m, camera.y_m] + view.ranges_m[hit, None] * ahead
        kept = self._points
        # A view that is not trusted may add obstacles but not remove them.
        if view.trusted:
            kept = kept[~_free_now(kept, camera, view)]
        kept = kept[np.hypot(*(kept - [camera.x_m, camera.y_m]).T) <= _REACH_M]
        self._points = _once(np.concatenate([kept, new[_near(new, self._last)]]))
        self._last = new

    def doubt(self, T_odom_base: SE2, nose_m: float, half_width_m: float) -> None:
        """Count the floor immediately ahead of the robot as blocked until the camera has seen it.

        Parameters
        ----------
        T_odom_base
            The robot's pose in the frame of the odometry.
        nose_m
            Distance from `base` to the robot's nose [m].
        half_width_m
            Half of its width [m].
        """
        across = np.linspace(-half_width_m, half_width_m, round(2.0 * half_width_m / _CELL_M) + 1)
        line = [T_odom_base.apply(nose_m, y_m) for y_m in across.tolist()]
        self._points = np.concatenate([self._points, line])

    def around(self, T_odom_base: SE2) -> list[Point]:
        """Return the points in `base` [m]."""
        T_base_odom = T_odom_base.inverse()
        return [T_base_odom.apply(*point) for point in self._points.tolist()]


def _free_now(points: NDArray[np.float64], camera: SE2, view: FloorView) -> NDArray[np.bool_]:
    """Return for which points a view sees floor instead, (k,)."""
    if len(view.angles_rad) == 0 or len(points) == 0:
        return np.zeros(len(points), np.bool_)
    offset = points - [camera.x_m, camera.y_m]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - camera.theta_rad
    off = np.abs(np.remainder(bearing[:, None] - view.angles_rad + np.pi, 2.0 * np.pi) - np.pi)
    beam = off.argmin(axis=1)
    beside = off[np.arange(len(points)), beam] * distance
    goes_on = view.ranges_m[beam] > distance + _SAME_M
    free: NDArray[np.bool_] = goes_on & (beside <= _CELL_M) & (distance >= view.nearest_m[beam])
    return free


def _near(points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points have one of the others near, (k,)."""
    if len(others) == 0:
        return np.zeros(len(points), np.bool_)
    offset = points[:, None] - others
    near: NDArray[np.bool_] = np.hypot(offset[..., 0], offset[..., 1]).min(axis=1) <= _SAME_M
    return near


def _once(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the last point of each cell."""
    cells = np.floor(points[::-1] / _CELL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept: NDArray[np.float64] = points[::-1][first]
    return kept
