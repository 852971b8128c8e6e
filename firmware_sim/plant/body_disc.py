"""The robot as people see it who evade it: one disc."""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_sim.world.walking.walker import Mover


def body_disc(
    corners: Sequence[tuple[float, float]],
    pose: tuple[float, float, float],
    motion: tuple[float, float, float],
) -> Mover:
    """Return a disc that covers a body, as it moves.

    One disc, since between several, each of which is evaded by itself, somebody would try to pass.

    Parameters
    ----------
    corners
        Corners of the body in base, x, y [m].
    pose
        Pose of base in world: x, y [m], heading [rad].
    motion
        Forward and lateral speed of base [m/s] and yaw rate [rad/s].
    """
    bx, by = (
        0.5 * (min(each[axis] for each in corners) + max(each[axis] for each in corners))
        for axis in (0, 1)
    )
    radius_m = max(math.dist((bx, by), each) for each in corners)
    x_m, y_m, heading_rad = pose
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    forward, lateral, omega = motion
    vx, vy = forward - omega * by, lateral + omega * bx
    place = x_m + c * bx - s * by, y_m + s * bx + c * by
    return Mover(*place, c * vx - s * vy, s * vx + c * vy, radius_m)
