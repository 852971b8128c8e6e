"""A behaviour driven in reverse: the robot leads with its rear."""

from __future__ import annotations

import math
from typing import Final

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
)
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.path.global_planning.goal import Goal

_TURNED: Final = SE2(0.0, 0.0, math.pi)


class Rearwards(Behaviour):
    """Runs a behaviour of a robot that is turned round while the robot is to drive in reverse.

    A differential drive is the same seen from behind, and one that steers is as far as its arcs go.
    Only for behaviours that look at nothing but the robot's pose and velocity.

    Parameters
    ----------
    behaviour
        The behaviour.
    robot
        Says at each step whether to drive in reverse.
    """

    def __init__(self, behaviour: Behaviour, robot: NavigatedRobot) -> None:
        self._behaviour = behaviour
        self._robot = robot

    @property
    def s_m(self) -> float:
        """Distance along the path [m]."""
        return self._behaviour.s_m

    def anchor(self, pose: SE2) -> Anchor | None:
        """Return where a robot found at `pose` continues."""
        return self._behaviour.anchor(pose)

    def join(self) -> None:
        """Continue near its anchor."""
        self._behaviour.join()

    def resume(self, s_m: float) -> None:
        """Continue at distance `s_m` along the path [m]."""
        self._behaviour.resume(s_m)

    def reset(self) -> None:
        """Start over."""
        self._behaviour.reset()

    def pause(self) -> None:
        """Another mode steers for a while."""
        self._behaviour.pause()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on."""
        self._behaviour.redirect(goal, speed_m_s)

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the behaviour's output, its speed backwards while that is asked for."""
        if not self._robot.reverse:
            return self._behaviour.step(situation, now_ns)
        twist = situation.twist
        turned = Twist(-twist.v_m_s, twist.omega_rad_s, -twist.vy_m_s)
        seen = situation._replace(pose=situation.pose @ _TURNED, twist=turned)
        step = self._behaviour.step(seen, now_ns)
        return step._replace(v_m_s=-step.v_m_s, vy_m_s=-step.vy_m_s)
