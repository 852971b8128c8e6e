"""Whether a holonomic robot meets something while it changes from one course to another.

Each axis of its velocity is limited by itself: told to drive ahead while it still slides to the
left, it goes ahead and to the left, where neither course leads. So it is driven ahead in thought:
for the reaction time towards the wanted velocity, and then braked. What it meets on that way is
what it could not stop before any more.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.twist import Twist
from robotctl.model.rectangle import Rectangle
from robotctl.planning.guard.swept_body import is_no_wall_beside

ROOM_M: Final = 0.02
"""Room round the body, for what a robot does otherwise than it is told [m]."""
_STEP_S: Final = 0.04
_LATE_S: Final = (0.0, 0.1)
"""Times after which a command may take effect [s]."""
_DEEPER_M: Final = 0.002
"""A point that is in the body already may get deeper by this [m]."""


class Agility(NamedTuple):
    """How fast a velocity changes: forward, turning, sideways [m/s^2, rad/s^2, m/s^2]."""

    gain: tuple[float, float, float]
    """Greatest change towards a set-point."""
    brake: tuple[float, float, float]
    """Guaranteed, to a stop."""
    reaction_s: float
    """Time for which the set-point is followed [s]."""


def is_free(
    body: Rectangle, points: NDArray[np.float64], now: Twist, wanted: Twist, agility: Agility
) -> bool:
    """Return whether a body meets no point while it follows a set-point and then brakes.

    Parameters
    ----------
    body
        The robot; `ROOM_M` is added all round.
    points
        (n, 2) in `base` [m].
    now, wanted
        Present velocity and set-point.
    agility
        Of the robot.
    """
    body = Rectangle(body.rear_m - ROOM_M, body.front_m + ROOM_M, body.half_width_m + ROOM_M)
    paths = [_path(now, wanted, agility, late_s) for late_s in _LATE_S]
    x, y, theta = np.concatenate(paths, axis=1)
    near = np.hypot(*points.T) <= body.reach_m + np.hypot(x, y).max()
    points = points[near]
    px, py = points[is_no_wall_beside(body, points)].T
    before = _depths(body, px, py)
    dx, dy = px - x[:, np.newaxis], py - y[:, np.newaxis]
    c, s = np.cos(theta)[:, np.newaxis], np.sin(theta)[:, np.newaxis]
    depths = _depths(body, c * dx + s * dy, c * dy - s * dx)
    return not ((depths >= 0.0) & (depths > before + _DEEPER_M)).any()


def _depths(body: Rectangle, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how deep points lie below the nearest side of a body [m]; < 0: outside."""
    ends = np.minimum(body.front_m - x, x - body.rear_m)
    depths: NDArray[np.float64] = np.minimum(ends, body.half_width_m - np.abs(y))
    return depths


def _path(now: Twist, wanted: Twist, agility: Agility, late_s: float) -> NDArray[np.float64]:
    """Return x, y and heading in the present `base` on the way to a stop, (3, k) [m, m, rad]."""
    start, target, brake = np.array(now), np.array(wanted), np.array(agility.brake)
    change = np.array(agility.gain) * agility.reaction_s
    fastest = start + np.clip(target - start, -change, change)
    most_s = late_s + agility.reaction_s + float((np.abs(fastest) / brake).max())
    times = (np.arange(np.ceil(most_s / _STEP_S)) + 0.5)[:, np.newaxis] * _STEP_S - late_s
    change = np.array(agility.gain) * times.clip(0.0, agility.reaction_s)
    speeds = start + np.clip(target - start, -change, change)
    lost = brake * (times - agility.reaction_s).clip(0.0)
    speeds = np.sign(speeds) * (np.abs(speeds) - lost).clip(0.0)
    v, omega, vy = speeds.T * _STEP_S
    theta = np.cumsum(omega)
    half = theta - 0.5 * omega
    c, s = np.cos(half), np.sin(half)
    return np.stack([np.cumsum(c * v - s * vy), np.cumsum(s * v + c * vy), theta])
