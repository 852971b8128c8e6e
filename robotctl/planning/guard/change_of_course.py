"""Whether a holonomic robot meets something while it changes from one course to another.

Each axis of its velocity is limited by itself: told to drive ahead while it still slides to the
left, it goes ahead and to the left, where neither course leads. So it is driven ahead in thought:
for the reaction time towards the wanted velocity, and then braked. What it meets on that way is
what it could not stop before any more.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.footprint_arrays import OFFSET, Sides
from robotctl.model.geometry.twist import Twist
from robotctl.planning.guard.swept_body import depth_below, is_no_wall_beside

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
    body: Sides, points: NDArray[np.float64], now: Twist, wanted: Twist, agility: Agility
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
    body = body.copy()
    body[:, OFFSET] += ROOM_M
    start, target = np.array(now, np.float64), np.array(wanted, np.float64)
    brake = np.array(agility.brake)
    change = np.array(agility.gain) * agility.reaction_s
    fastest = start + np.clip(target - start, -change, change)
    most_s = agility.reaction_s + float((np.abs(fastest) / brake).max())
    motion = _Motion(start, target, np.array(agility.gain), brake, agility.reaction_s, most_s)
    return not _meets(body, np.ascontiguousarray(points), motion)


class _Motion(NamedTuple):
    """A velocity that follows a set-point and then ends."""

    start: NDArray[np.float64]
    """Velocity forward, turning and sideways, (3,)."""
    target: NDArray[np.float64]
    gain: NDArray[np.float64]
    brake: NDArray[np.float64]
    reaction_s: float
    most_s: float
    """Time until it has ended at the latest [s]."""


@compiled
def _meets(body: Sides, points: NDArray[np.float64], motion: _Motion) -> bool:
    """Return whether a point gets deeper into the body on the way to a stop."""
    kept = is_no_wall_beside(body, points)
    for late_s in _LATE_S:
        x, y, theta = 0.0, 0.0, 0.0
        for step in range(math.ceil((late_s + motion.most_s) / _STEP_S)):
            v, omega, vy = _velocity(motion, (step + 0.5) * _STEP_S - late_s)
            half = theta + 0.5 * omega * _STEP_S
            c, s = math.cos(half), math.sin(half)
            x += _STEP_S * (c * v - s * vy)
            y += _STEP_S * (s * v + c * vy)
            theta += omega * _STEP_S
            c, s = math.cos(theta), math.sin(theta)
            for number in range(len(points)):
                if not kept[number]:
                    continue
                px, py = points[number, 0], points[number, 1]
                dx, dy = px - x, py - y
                depth = depth_below(body, c * dx + s * dy, c * dy - s * dx)
                if depth >= 0.0 and depth > depth_below(body, px, py) + _DEEPER_M:
                    return True
    return False


@compiled
def _velocity(motion: _Motion, time_s: float) -> tuple[float, float, float]:
    """Return the velocity at a time after the command takes effect."""
    change = min(max(time_s, 0.0), motion.reaction_s)
    lost = max(time_s - motion.reaction_s, 0.0)
    return (
        _speed(motion, 0, change, lost),
        _speed(motion, 1, change, lost),
        _speed(motion, 2, change, lost),
    )


@compiled
def _speed(motion: _Motion, axis: int, change: float, lost: float) -> float:
    """Return the speed along an axis that has changed, and been braked, for so long [s]."""
    most = motion.gain[axis] * change
    speed = motion.start[axis]
    speed += min(max(motion.target[axis] - speed, -most), most)
    return math.copysign(max(abs(speed) - motion.brake[axis] * lost, 0.0), speed)
