"""A behaviour under supervision: obstacles and time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    Stopwatch,
    failed,
)
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import GuardStep, ObstacleGuard

if TYPE_CHECKING:
    from robotctl.planning.path.global_planning.goal import Goal

_STANDSTILL_M_S: Final = 0.03
"""Below this allowed speed the robot stands still."""


def limited(step: BehaviourOutput, guard: ObstacleGuard) -> tuple[BehaviourOutput, GuardStep]:
    """Return `step` slowed to what the guard allows, on the same arc, and the guard's verdict.

    The navigator does so to all that drives by itself, once and last. Others may ask beforehand.
    """
    allowed = guard.step(*step.twist)
    speed = step.twist.speed_m_s or abs(step.omega_rad_s) * guard.reach_m
    if speed <= allowed.v_max_m_s:
        return step, allowed
    share = allowed.v_max_m_s / speed if allowed.v_max_m_s >= _STANDSTILL_M_S else 0.0
    text = f"waiting: {allowed.obstacle}" if share == 0.0 else step.text
    v_m_s, omega_rad_s, vy_m_s = (share * each for each in step.twist)
    slowed = step._replace(v_m_s=v_m_s, omega_rad_s=omega_rad_s, vy_m_s=vy_m_s, text=text)
    return slowed, allowed


class Guarded(Behaviour):
    """Runs a behaviour that fails where the guard lets the robot stand, or time is over.

    The robot slows down, stops ahead of an obstacle and continues when it is gone; after
    `GuardConfig.blocked_max_s` in one place the behaviour fails. `limited` does the slowing.

    Parameters
    ----------
    behaviour
        The behaviour.
    guard
        Shared with the other behaviours; the navigator feeds it.
    config
        Of the guard.
    time_out_s
        The behaviour fails after this time [s]; None: never.
    """

    def __init__(
        self,
        behaviour: Behaviour,
        guard: ObstacleGuard,
        config: GuardConfig,
        time_out_s: float | None = None,
    ) -> None:
        self._behaviour = behaviour
        self._guard = guard
        self._blocked_max_ns = round(config.blocked_max_s * 1e9)
        self._time_out_s = time_out_s
        self._watch = Stopwatch()
        self._blocked_ns: int | None = None

    @property
    def s_m(self) -> float:
        """Distance along the path or wall [m]; 0 for a behaviour without one."""
        return self._behaviour.s_m

    def anchor(self, pose: SE2) -> Anchor | None:
        """Return where a robot found at `pose` continues; None: nowhere, or not begun."""
        return self._behaviour.anchor(pose)

    def join(self) -> None:
        """Continue near its anchor, with the full time again."""
        self.retry()
        self._behaviour.join()

    def resume(self, s_m: float) -> None:
        """Continue at distance `s_m` along the path or wall [m]; without one, start over."""
        self.reset()
        self._behaviour.resume(s_m)

    def reset(self) -> None:
        """Start over."""
        self._behaviour.reset()
        self._watch = Stopwatch()
        self._blocked_ns = None

    def pause(self) -> None:
        """Another mode steers for a while; the behaviour's time stands still."""
        self._behaviour.pause()
        self._watch.pause()
        self._blocked_ns = None

    def retry(self) -> None:
        """Continue after a failure from the robot's present place, with the full time again."""
        self.pause()
        self._watch = Stopwatch()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on."""
        self._behaviour.redirect(goal, speed_m_s)

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the behaviour's output, as long as obstacles and time allow."""
        spent_ns = self._watch.step(now_ns)
        step = self._behaviour.step(situation, now_ns)
        if step.status is not Status.RUNNING:
            return step
        if self._time_out_s is not None and spent_ns > self._time_out_s * 1e9:
            return failed(f"not done after {self._time_out_s:g} s ({step.text})")
        allowed = self._guard.step(*step.twist)
        if allowed.v_max_m_s >= _STANDSTILL_M_S:
            self._blocked_ns = None
        elif self._blocked_ns is None:
            self._blocked_ns = now_ns
        elif now_ns - self._blocked_ns > self._blocked_max_ns:
            self._blocked_ns = None
            return failed(f"blocked for {self._blocked_max_ns / 1e9:g} s: {allowed.obstacle}")
        return step
