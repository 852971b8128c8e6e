"""The strip of floor that a moving thing takes if it goes straight on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle


class Lane(NamedTuple):
    """Strip of floor from the place of a moving thing on, in its direction and as wide as it is.

    It holds as long as that neither turns nor stops.
    """

    x_m: float
    y_m: float
    """Place in `world` [m]."""
    ahead_x: float
    ahead_y: float
    """Direction, a unit vector."""
    speed_m_s: float
    radius_m: float
    is_heard: bool = False
    """Whether only a sonar tells of it: neither its side nor its direction is known."""

    @classmethod
    def of(cls, moving: NDArray[np.float64], *, is_heard: bool = False) -> Lane:
        """Return the lane of a row of `LocalSituation.moving`, which moves."""
        x_m, y_m, vx_m_s, vy_m_s, radius_m = moving.tolist()
        speed_m_s = math.hypot(vx_m_s, vy_m_s)
        ahead = vx_m_s / speed_m_s, vy_m_s / speed_m_s
        return cls(x_m, y_m, *ahead, speed_m_s, radius_m, is_heard)

    def through(self, x_m: float, y_m: float) -> Lane:
        """Return the lane moved to the side so that its middle leads through a place [m]."""
        return self.aside(-float(self.beside_m(np.array([x_m, y_m]))))

    @property
    def heading_rad(self) -> float:
        """Direction in `world` [rad]."""
        return math.atan2(self.ahead_y, self.ahead_x)

    def straightened(self, along_rad: float, within_rad: float) -> Lane:
        """Return the lane along a line, in either direction, if it hardly differs from that."""
        off_rad = wrap_angle(along_rad - self.heading_rad)
        if abs(off_rad) > 0.5 * math.pi:
            along_rad += math.pi
            off_rad = wrap_angle(off_rad + math.pi)
        if abs(off_rad) > within_rad:
            return self
        return self._replace(ahead_x=math.cos(along_rad), ahead_y=math.sin(along_rad))

    def after(self, time_s: float) -> Lane:
        """Return the lane from where its user is after some time on it [s]."""
        way_m = self.speed_m_s * time_s
        x_m, y_m = self.x_m + way_m * self.ahead_x, self.y_m + way_m * self.ahead_y
        return self._replace(x_m=x_m, y_m=y_m)

    def aside(self, way_m: float) -> Lane:
        """Return the lane beside this one, so far to the right [m]."""
        x_m, y_m = self.x_m + way_m * self.ahead_y, self.y_m - way_m * self.ahead_x
        return self._replace(x_m=x_m, y_m=y_m)

    def ahead_m(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far ahead along the lane places (..., 2) are [m], (...); < 0: behind."""
        away: NDArray[np.float64] = places - (self.x_m, self.y_m)
        return away[..., 0] * self.ahead_x + away[..., 1] * self.ahead_y

    def beside_m(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far to the left of its middle places (..., 2) are [m], (...)."""
        away: NDArray[np.float64] = places - (self.x_m, self.y_m)
        return away[..., 1] * self.ahead_x - away[..., 0] * self.ahead_y

    def gaps_m(
        self, corners: NDArray[np.float64], poses: NDArray[np.float64], strays: float
    ) -> NDArray[np.float64]:
        """Return the gap between the lane and a body at poses (n, 3) of `world` [m], (n,).

        Parameters
        ----------
        corners
            Corners of the body in `base`, (k, 2) [m].
        poses
            Poses of `base` [m, m, rad].
        strays
            How much wider the lane gets to each side, per metre ahead.

        Returns
        -------
        NDArray
            Below 0 where the body reaches into the lane; inf where all of it is behind.
        """
        cos, sin = np.cos(poses[:, 2, np.newaxis]), np.sin(poses[:, 2, np.newaxis])
        x = poses[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
        y = poses[:, 1:2] + sin * corners[:, 0] + cos * corners[:, 1]
        places = np.stack([x, y], axis=2)
        beside_m, ahead_m = self.beside_m(places), self.ahead_m(places).max(axis=1)
        off_m = np.maximum(beside_m.min(axis=1), -beside_m.max(axis=1))
        gaps_m = off_m - self.radius_m - strays * np.maximum(ahead_m, 0.0)
        return np.where(ahead_m < -self.radius_m, np.inf, gaps_m)
