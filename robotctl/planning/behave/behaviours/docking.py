"""Parts shared by docking to a wall and docking to a marker."""

from __future__ import annotations

import math
from typing import Final

from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.pursuit import turn_rate

SQUARE_RAD: Final = math.radians(2.0)
"""A robot that can turn on the spot does so until it is that square [rad]."""
SKEW_MAX_RAD: Final = math.radians(6.0)
"""A robot that ends farther off square than this has failed [rad]."""
NEAR_M: Final = 0.01
"""Error of the distance within which the dock counts as reached [m]."""
_TURNS: Final = PursuitConfig(omega_max_rad_s=0.3)
"""Slow turns: what it docks to is seen late."""
_BRAKES_M_S2: Final = 0.1
_CREEP_M_S: Final = 0.05
"""Braking [m/s^2] before the dock, and the slowest speed there [m/s]."""


def turn(skew_rad: float, text: str) -> BehaviourOutput:
    """Return a turn on the spot, by which a robot that is `skew_rad` off becomes square."""
    return BehaviourOutput(0.0, turn_rate(skew_rad, _TURNS), text=text)


def approach_speed(left_m: float, most_m_s: float) -> float:
    """Return the speed at a distance from where the robot is to stand [m/s]."""
    return max(min(most_m_s, math.sqrt(2.0 * _BRAKES_M_S2 * left_m)), _CREEP_M_S)
