"""The robot as people see it who evade it: one disc."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from firmware_sim.world.walking.walker import Mover


class BodyDisc(NamedTuple):
    """Disc that covers a body: middle in base and radius [m].

    One disc, since between several, each of which is evaded by itself, somebody would try to pass.
    """

    x_m: float
    y_m: float
    radius_m: float

    @classmethod
    def around(cls, corners: Sequence[tuple[float, float]]) -> BodyDisc:
        """Return the disc about the middle of the corners of a body in base, x, y [m]."""
        x_m, y_m = (
            0.5 * (min(each[axis] for each in corners) + max(each[axis] for each in corners))
            for axis in (0, 1)
        )
        return cls(x_m, y_m, max(math.dist((x_m, y_m), each) for each in corners))

    def moving(self, pose: tuple[float, float, float], motion: tuple[float, float, float]) -> Mover:
        """Return the disc as it moves.

        Parameters
        ----------
        pose
            Pose of base in world: x, y [m], heading [rad].
        motion
            Forward and lateral speed of base [m/s] and yaw rate [rad/s].
        """
        x_m, y_m, heading_rad = pose
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        forward, lateral, omega = motion
        vx, vy = forward - omega * self.y_m, lateral + omega * self.x_m
        place = x_m + c * self.x_m - s * self.y_m, y_m + s * self.x_m + c * self.y_m
        return Mover(*place, c * vx - s * vy, s * vx + c * vy, self.radius_m)
