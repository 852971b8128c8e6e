"""Turning round on the spot before the robot drives along its path."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput
from robotctl.planning.behave.journey.rungs import TURNS_RAD, poses_after
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.path.global_planning.route import Route

_CHORD_M: Final = 0.25
"""Chord used to estimate the path's direction [m]."""
_TURNS_RAD_S: Final = 0.3
"""Rate from which on a turn has begun, and keeps its side [rad/s]."""


class _Law(NamedTuple):
    """When a robot turns round, and how fast."""

    begin_rad: float
    """Heading error from which on it turns [rad]."""
    end_rad: float
    """Heading error at which it drives on [rad]."""
    rate_rad_s: float


_AHEAD: Final = _Law(2.85, 1.2, 1.2)
_FIRST: Final = _Law(0.3, 0.1, 1.2)
"""Turn before a robot drives that must not drive on as it looks now."""


class TurnRound:
    """Turns a robot that looks the wrong way.

    Controllers look for better velocities near the present one, and straight away from the path
    neither turn is better.

    Parameters
    ----------
    tools
        World and paths.
    """

    def __init__(self, tools: JourneyTools) -> None:
        self._tools = tools
        self._backwards = _Law(1.2, 0.15, tools.journey.rungs.turn_rad_s)
        self._turns = False

    def reset(self) -> None:
        """Begin no turn that is not needed."""
        self._turns = self._is_first = False

    def face_path(self) -> None:
        """Look along the next path before the robot drives."""
        self._is_first = True

    def step(self, situation: BehaviourInput, route: Route) -> float:
        """Return the turning rate [rad/s]; 0 where it need not turn, or has no room to."""
        pose, omega_rad_s = situation.pose, situation.twist.omega_rad_s
        back = route.rest[0, :2] - route.rest[:, :2]
        away = np.flatnonzero(np.hypot(*back.T) > _CHORD_M)
        if self._tools.paths.steered or not len(away):
            self._turns = False
            return 0.0
        law = _FIRST if self._is_first else _AHEAD
        wanted_rad = float(route.rest[away[0], 2])
        if self._tools.paths.reverse:
            law, wanted_rad = self._backwards, math.atan2(back[away[0], 1], back[away[0], 0])
        off_rad = wrap_angle(wanted_rad - pose.theta_rad)
        self._turns = abs(off_rad) > (law.end_rad if self._turns else law.begin_rad)
        if not self._turns:
            self._is_first = False
            return 0.0
        side = math.copysign(1.0, off_rad)
        if abs(omega_rad_s) > _TURNS_RAD_S and not self._tools.paths.reverse:
            side = math.copysign(1.0, omega_rad_s)  # as the controller has begun
        swept = poses_after(pose, [SE2(0.0, 0.0, side * turn_rad) for turn_rad in TURNS_RAD])
        if self._tools.world.touches(swept):
            return 0.0
        return side * min(law.rate_rad_s, 2.0 * abs(off_rad))
