"""The way of a robot that was carried away, back to where its mission was interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple, Protocol

from robotctl.model.drives.drives import Drive
from robotctl.planning.behaviours.behaviours import GoTo, TurnTo
from robotctl.planning.guard.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
)
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.local.path import Point
from robotctl.planning.local.pursuit import PursuitConfig

_NEAR_M: Final = 0.2
"""Corners of the way are passed within this distance [m]."""


class Paths(Protocol):
    """Knows free paths through the world: a member of `PLANNERS`."""

    def way(self, start: Point, goal: Point) -> list[Point]:
        """Return the corners after `start`, `goal` the last; none where there is no path."""


class Anchor(NamedTuple):
    """Where an item was interrupted, in `world`; a heading where it matters [rad]."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


class Rejoin:
    """Drives from corner to corner, then turns to the heading where one is wanted.

    Parameters
    ----------
    corners
        Of the way in `world` [m], the end the last; at least one.
    heading_rad
        At the end [rad]; None: any. A robot that cannot turn on the spot ends with any.
    config, drive, speed_m_s, guard
        As for `GoTo`.
    """

    def __init__(
        self,
        corners: Sequence[Point],
        heading_rad: float | None,
        config: PursuitConfig,
        drive: Drive,
        speed_m_s: float,
        guard: ObstacleGuard,
    ) -> None:
        near = replace(config, goal_tolerance_m=max(_NEAR_M, config.goal_tolerance_m))
        self._all: list[Behaviour] = [
            GoTo(x_m, y_m, near, drive, speed_m_s, guard) for x_m, y_m in corners
        ]
        if heading_rad is not None and not drive.steered:
            self._all.append(TurnTo(heading_rad, config))
        self.reset()

    def reset(self) -> None:
        """Begin with the first corner."""
        self._left = list(self._all)
        self.pause()

    def pause(self) -> None:
        """Go on to the corner that it was at."""
        for each in self._left:
            each.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at the end."""
        while self._left:
            step = self._left[0].step(situation, now_ns)
            if step.status is not Status.DONE:
                return step._replace(text=f"back to where it was interrupted, {step.text}")
            del self._left[0]
        return done()
