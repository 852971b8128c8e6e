"""Walkers who go about at random: wanderers, and children who run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.walking.walker import STEP_S, Place, Walker

_TRIES: Final = 24
_PROBE_M: Final = 0.3
"""Free length that a new direction needs [m]."""


@dataclass(frozen=True, slots=True)
class Habit:
    """Ranges of random speeds, times and turns; each pair is the least and the greatest."""

    goes_m_s: tuple[float, float]
    goes_s: tuple[float, float]
    stands_s: tuple[float, float]
    stands_share: float
    """Probability of standing before going on."""
    turn_rad: float
    """Standard deviation of the turn before going on [rad]."""
    bend_rad_s: float
    """Fastest turn while going [rad/s]."""


def wandering(speed_m_s: float) -> Habit:
    """Return the habit of a wanderer whose fastest speed is given."""
    return Habit((0.2 * speed_m_s, speed_m_s), (1.0, 5.0), (0.5, 3.0), 0.3, 0.8, 0.5)


RUNNING: Final = Habit((1.5, 2.5), (0.4, 2.0), (0.2, 1.5), 0.4, 1.5, 0.3)
"""Habit of a child that runs."""


class Roaming(Walker):
    """Walker who goes for a while in a direction, perhaps stands, and draws again.

    Parameters
    ----------
    place
        Where it begins, in the free space.
    habit
        What it draws.
    space
        Places where it may be.
    rng
        Generator of all draws.
    """

    __slots__ = (
        "_bend_rad", "_goes_s", "_habit", "_heading_rad", "_rng", "_space", "_speed_m_s",
        "_stands_s",
    )  # fmt: skip

    def __init__(
        self, place: Place, habit: Habit, space: FreeSpace, rng: np.random.Generator
    ) -> None:
        super().__init__(place)
        self._habit, self._space, self._rng = habit, space, rng
        self._heading_rad = float(rng.uniform(-math.pi, math.pi))
        self._draw(self._heading_rad)

    def _draw(self, heading_rad: float) -> None:
        """Draw what comes next: a direction about the given one, a speed and times."""
        rng, habit = self._rng, self._habit
        stands = rng.random() < habit.stands_share
        self._stands_s = float(rng.uniform(*habit.stands_s)) if stands else 0.0
        self._goes_s = float(rng.uniform(*habit.goes_s))
        self._speed_m_s = float(rng.uniform(*habit.goes_m_s))
        self._bend_rad = float(rng.uniform(-habit.bend_rad_s, habit.bend_rad_s)) * STEP_S
        for _ in range(_TRIES):
            self._heading_rad = heading_rad + float(rng.normal(0.0, habit.turn_rad))
            if self._space.is_free(self._towards(_PROBE_M)):
                return
            heading_rad += 2.0 * math.pi / _TRIES  # at last all directions have been about it

    def _towards(self, distance_m: float) -> Place:
        """Return the place at a distance straight ahead [m]."""
        x_m, y_m = self.place
        return (
            x_m + distance_m * math.cos(self._heading_rad),
            y_m + distance_m * math.sin(self._heading_rad),
        )

    def ahead(self) -> Place:
        """Return the place after a step; before a wall the next draw begins with standing."""
        if self._stands_s > 0.0:
            return self.place
        ahead = self._towards(self._speed_m_s * STEP_S)
        if self._space.is_free(ahead):
            return ahead
        self._draw(self._heading_rad)
        return self.place

    def go(self, ahead: Place) -> None:
        """Do the step."""
        self.place = ahead
        if self._stands_s > 0.0:
            self._stands_s -= STEP_S
            return
        self._goes_s -= STEP_S
        self._heading_rad += self._bend_rad
        if self._goes_s <= 0.0:
            self._draw(self._heading_rad)

    def turn_round(self) -> None:
        """Go about the other way."""
        self._draw(self._heading_rad + math.pi)
