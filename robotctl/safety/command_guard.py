"""The last check of an actuator command, after every other layer and just before the wire.

It expects to find nothing: every layer before it keeps its own limits. Anything it finds is a
defect, so it does not repair single values but turns the whole command into a stop. One wheel
turning while the other is zeroed would spin the robot.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

TOLERANCE: Final = 1e-6
"""A value beyond its range by no more than this is rounding, and is clamped [duty, rad]."""


class GuardedCommand(NamedTuple):
    """The command that may be sent; `fault` says briefly what was wrong, empty if nothing was."""

    enable: bool
    duty1: float
    duty2: float
    steering_rad: float
    fault: str


def clamp(value: float, bound: float) -> float:
    """Return `value` limited to [-bound, bound]; bound >= 0. A nan stays one."""
    if value > bound:
        return bound
    if value < -bound:
        return -bound
    return value


def guard_command(
    enable: bool,
    duty1: float,
    duty2: float,
    steering_rad: float,
    steering_max_rad: float = math.pi / 2,
    steering_held_rad: float = 0.0,
) -> GuardedCommand:
    """Return the command that may be sent.

    Duties are zero unless enabled. A value that is not finite or lies outside its range makes it
    a disabled command with zero duties, and the steering stays where it is.

    Parameters
    ----------
    enable
        Whether the bridge is to be on.
    duty1, duty2
        Duties, [-1, 1].
    steering_rad
        Steering angle [rad], within +-`steering_max_rad`, positive left.
    steering_max_rad
        Bound of the linkage [rad], >= 0.
    steering_held_rad
        Angle to hold where the demanded one is refused [rad]: the last one sent.
    """
    # False for nan as well.
    if not (abs(duty1) <= 1.0 + TOLERANCE and abs(duty2) <= 1.0 + TOLERANCE):
        fault = f"duties {duty1}, {duty2}: [-1, 1] allowed"
    elif not abs(steering_rad) <= steering_max_rad + TOLERANCE:
        fault = f"steering {steering_rad} rad: {steering_max_rad} rad to either side allowed"
    elif enable:
        return GuardedCommand(
            True,
            clamp(duty1, 1.0),
            clamp(duty2, 1.0),
            clamp(steering_rad, steering_max_rad),
            "",
        )
    else:
        return GuardedCommand(False, 0.0, 0.0, clamp(steering_rad, steering_max_rad), "")
    # The steering holds its last angle: a sudden swing is unsafe motion, too.
    held = steering_held_rad if math.isfinite(steering_held_rad) else 0.0
    return GuardedCommand(False, 0.0, 0.0, clamp(held, steering_max_rad), fault)
