"""Driving to one of a few spots, in a frame that may turn out to lie a little elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.journey.journey import DriveTo, Journey
from robotctl.planning.journey_config import TravelConfig
from robotctl.planning.map.live_world import LiveWorld
from robotctl.planning.path.global_planning.goal import Goal

_HEADINGS: Final = (0.0, math.pi / 3.0, 2.0 * math.pi / 3.0)
"""A body with room in these is taken to have room in any."""


class Approach:
    """Drives to the first of some spots that is free; to the first of all if none is.

    Parameters
    ----------
    world
        Knows what is free.
    drive_to
        Makes the journey to a spot.
    speed_m_s
        Largest speed [m/s].
    config
        See there.
    """

    def __init__(
        self,
        world: LiveWorld,
        drive_to: DriveTo,
        speed_m_s: float,
        config: TravelConfig = TravelConfig(),  # noqa: B008
    ) -> None:
        self._config = config
        self._look_ns = round(1e9 * config.spot_look_s)
        self._world = world
        self._drive_to = drive_to
        self._speed_m_s = speed_m_s
        self.reset()

    def reset(self) -> None:
        """Choose a spot and plan again in the next step."""
        self._name = ""
        self._journey: Journey | None = None
        self._spot = 0
        self._target = SE2()
        self._changes = 0
        self._looked_ns = 0

    def step(
        self,
        name: str,
        spots_world: Sequence[SE2],
        situation: BehaviourInput,
        now_ns: int,
    ) -> BehaviourOutput:
        """Return the next velocity; another name means other spots."""
        if name != self._name:
            self.reset()
            self._name = name
        may_change = self._changes < self._config.spot_changes
        if may_change and now_ns - self._looked_ns >= self._look_ns:
            self._looked_ns = now_ns
            self._choose(spots_world, situation.pose)
        wanted = spots_world[self._spot]
        off_m = math.hypot(wanted.x_m - self._target.x_m, wanted.y_m - self._target.y_m)
        if self._journey is None or off_m >= self._config.shifted_m:
            self._target = wanted
            self._journey = self._drive_to(Goal(wanted.x_m, wanted.y_m), self._speed_m_s)
        return self._journey.step(situation, now_ns)

    def _choose(self, spots: Sequence[SE2], pose: SE2) -> None:
        """Take another spot if the present one is not free, and that is."""
        if self._is_free(spots[self._spot], pose):
            return
        free = [number for number, spot in enumerate(spots) if self._is_free(spot, pose)]
        if free:
            self._changes += 1
            self._spot = free[0]

    def _is_free(self, spot: SE2, pose: SE2) -> bool:
        """Return whether nothing is seen at a spot."""
        if math.hypot(spot.x_m - pose.x_m, spot.y_m - pose.y_m) > self._config.spot_range_m:
            return True
        turned = [(spot.x_m, spot.y_m, heading_rad) for heading_rad in _HEADINGS]
        return not self._world.touches(np.array(turned))
