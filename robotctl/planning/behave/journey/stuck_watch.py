"""Whether a robot that is on its way has stood for too long."""

from __future__ import annotations

import math
from typing import Final

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput
from robotctl.planning.map.live_world import LiveWorld
from robotctl.planning.path.local.controller import LocalMotion

_STUCK_NS: Final = 1_500_000_000
"""A robot that wants to drive and stands for this long is in trouble [ns]."""
_PATIENT_NS: Final = 6_000_000_000
"""The same near a person, who is likely to move on [ns]."""
_STANDS_M_S: Final = 0.02
_STANDS_RAD_S: Final = 0.05
_LEFT_M: Final = 0.03
_LEFT_RAD: Final = 0.05
"""A robot that only sways where it came to stand, since the guard holds it, still stands."""


class StuckWatch:
    """Measures how long the robot has stood.

    Parameters
    ----------
    world
        Knows whether a person is near.
    """

    def __init__(self, world: LiveWorld) -> None:
        self._world = world
        self._since_ns: int | None = None
        """When the robot came to stand [ns]; None: it moves."""
        self._pose = SE2()
        """Pose in which it did."""

    def reset(self) -> None:
        """Note that the robot moves, or that its time does not count."""
        self._since_ns = None

    def begin(self, pose: SE2, now_ns: int) -> None:
        """Note that the robot stands from now on, if it does not already."""
        if self._since_ns is None:
            self._since_ns, self._pose = now_ns, pose

    def step(self, situation: BehaviourInput, motion: LocalMotion, now_ns: int) -> bool:
        """Return whether the robot has stood for too long."""
        pose, twist = situation.pose, situation.twist
        stands = abs(twist.v_m_s) < _STANDS_M_S and abs(twist.omega_rad_s) < _STANDS_RAD_S
        if self._since_ns is None:
            if stands or motion.blocked:
                self.begin(pose, now_ns)
        elif not motion.blocked and self._has_left(pose):
            self._since_ns = None
        longest_ns = _PATIENT_NS if self._world.is_somebody_near(pose) else _STUCK_NS
        return self._since_ns is not None and now_ns - self._since_ns > longest_ns

    def is_patient(self, pose: SE2, now_ns: int) -> bool:
        """Return whether the robot, having waited for a person nearby, goes on waiting."""
        if self._since_ns is None or not self._world.is_somebody_near(pose):
            return False
        return now_ns - self._since_ns <= _PATIENT_NS

    @property
    def stands(self) -> bool:
        """Whether the robot has come to stand."""
        return self._since_ns is not None

    def _has_left(self, pose: SE2) -> bool:
        """Return whether the robot is elsewhere than where it came to stand, or has turned."""
        turned_rad = wrap_angle(pose.theta_rad - self._pose.theta_rad)
        return distance_m(self._pose, pose) > _LEFT_M or abs(turned_rad) > _LEFT_RAD


def distance_m(one: SE2, other: SE2) -> float:
    """Return how far two poses are apart [m]."""
    return math.dist((one.x_m, one.y_m), (other.x_m, other.y_m))
