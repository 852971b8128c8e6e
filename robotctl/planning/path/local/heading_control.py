"""Turning to a direction while driving along it."""

from __future__ import annotations

import math
from typing import Final

from robotctl.control.servoing import ServoConfig, servo
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.twist import Twist

_HEADING: Final = ServoConfig(kp=2.0, direction=1)
"""Turning left raises the heading: a turning rate of 2 rad/s for each radian of error."""

BEND_SHARE: Final = 0.3
"""Share of the speed with which a robot that cannot turn on the spot turns to a direction."""


def towards(heading_rad: float, v_m_s: float, theta_rad: float, *, steered: bool) -> Twist:
    """Return the velocity of `base` that turns it to a direction and drives along that.

    Facing away it turns on the spot first instead of driving off in the wrong direction, or in a
    bend, as slowly as it may.

    Parameters
    ----------
    heading_rad
        The direction in `world` [rad].
    v_m_s
        Speed along it [m/s].
    theta_rad
        Present heading in `world` [rad].
    steered
        The robot cannot turn on the spot.
    """
    error_rad = wrap_angle(heading_rad - theta_rad)
    share = max(BEND_SHARE if steered else 0.0, math.cos(error_rad))
    return Twist(v_m_s * share, turn_towards(heading_rad, theta_rad))


def turn_towards(heading_rad: float, theta_rad: float) -> float:
    """Return the turning rate from a heading to another one of `world` [rad/s]."""
    return servo(_HEADING, wrap_angle(heading_rad - theta_rad), 0.0)
