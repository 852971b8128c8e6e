"""Walkers who follow a path and evade the robot, other people and walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from firmware_sim.world.walking.orca import HalfPlane, Velocity, choose, off_mover, off_wall
from firmware_sim.world.walking.path import ClosedPath
from firmware_sim.world.walking.walker import (
    LOOK_S,
    RADIUS_M,
    STEP_S,
    Mover,
    Place,
    Walker,
)

HORIZON_S: Final = 2.0
"""Time without a contact that it looks ahead [s]."""
WALL_HORIZON_S: Final = 0.4
HURRY: Final = 1.3
"""Fastest speed, by the usual one."""
APART_M: Final = 0.08
"""Gap that it keeps from others, if there is room [m]."""
AHEAD_M: Final = 0.8
"""Distance of the point of its path towards which it walks [m]."""
SIGHT_M: Final = 5.0
TURNS_RAD: Final = (-0.05, -1.0, 1.0)
"""Turns of its wish, right first, of which it takes the next while it does not get on: exactly
head-on, straight ahead alone would stand for ever."""
GETS_ON: Final = 0.5
"""Speed at which it gets on, by the usual one."""
PROGRESS_M: Final = 0.1
STUCK_S: Final = 4.0
"""Time without progress after which it turns back [s]."""


class Evading(Walker):
    """A closed path, and a velocity by ORCA that is chosen each `LOOK_S`.

    It does half of the evading towards others who evade, all of it towards the robot and who does
    not. Walls it never touches; where others leave no room, it comes nearer to them.

    Parameters
    ----------
    corners
        Corners of the path, the first again at the end, (k, 2) [m].
    speed_m_s
        Speed on a free path [m/s].
    walls
        Sides of what stands, (n, 4): from x, y to x, y [m].
    """

    __slots__ = ("_at_m", "_path", "_sign", "_since_s", "_speed_m_s", "_velocity", "_walls")

    looks = True

    def __init__(self, corners: np.ndarray, speed_m_s: float, walls: np.ndarray) -> None:
        self._path = ClosedPath(corners)
        self._speed_m_s = speed_m_s
        self._walls = walls
        self._at_m, self._sign, self._since_s = 0.0, 1.0, 0.0
        self._velocity: Velocity = (0.0, 0.0)
        super().__init__(self._path.along(0.0))

    def look(self, others: Sequence[Mover]) -> None:
        """Choose a velocity for the next `LOOK_S`."""
        self._follow()
        me = Mover(*self.place, *self._velocity, RADIUS_M + APART_M)
        soft = [
            off_mover(me, each, 0.5 if each.evades else 1.0, HORIZON_S, LOOK_S)
            for each in others
            if math.hypot(each.x_m - me.x_m, each.y_m - me.y_m) < SIGHT_M
        ]
        fastest_m_s = HURRY * self._speed_m_s
        hard = self._off_walls(fastest_m_s)
        found = []
        for turn_rad in TURNS_RAD:
            velocity = choose(self._wish(turn_rad), fastest_m_s, hard, soft)
            found.append(velocity)
            if math.hypot(*velocity) > GETS_ON * self._speed_m_s:
                break
        self._velocity = max(found, key=lambda each: math.hypot(*each))

    def _follow(self) -> None:
        """Move the point of the path on while it is near or comes nearer; turn back when stuck."""
        begin_m, distance_m = self._at_m, self._distance_m(self._at_m)
        while abs(self._at_m - begin_m) < AHEAD_M:
            next_m = self._at_m + self._sign * PROGRESS_M
            next_distance_m = self._distance_m(next_m)
            if distance_m >= AHEAD_M and next_distance_m >= distance_m:
                break
            self._at_m, distance_m = next_m, next_distance_m
        self._since_s = self._since_s + LOOK_S if self._at_m == begin_m else 0.0
        if self._since_s > max(STUCK_S, 3.0 * PROGRESS_M / self._speed_m_s):
            self.turn_round()

    def _distance_m(self, at_m: float) -> float:
        """Return the distance from a point of the path [m]."""
        return math.dist(self._path.along(at_m), self.place)

    def _wish(self, turn_rad: float) -> Velocity:
        """Return the velocity along the path, turned by an angle [m/s]."""
        x_m, y_m = self._path.along(self._at_m)
        angle_rad = math.atan2(y_m - self.place[1], x_m - self.place[0]) + turn_rad
        return self._speed_m_s * math.cos(angle_rad), self._speed_m_s * math.sin(angle_rad)

    def _off_walls(self, fastest_m_s: float) -> list[HalfPlane]:
        """Return the half-planes of all walls within reach."""
        ax, ay, bx, by = self._walls.T
        x, y = self.place
        dx, dy = bx - ax, by - ay
        share = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        near_x, near_y = ax + share * dx, ay + share * dy
        distance_m = np.hypot(near_x - x, near_y - y)
        within = (distance_m < RADIUS_M + fastest_m_s * WALL_HORIZON_S) & (distance_m > 0.0)
        points = zip(near_x[within].tolist(), near_y[within].tolist(), strict=True)
        return [off_wall(self.place, each, RADIUS_M, WALL_HORIZON_S) for each in points]

    def ahead(self) -> Place:
        """Return the place after a step at the chosen velocity."""
        (x_m, y_m), (vx_m_s, vy_m_s) = self.place, self._velocity
        return x_m + vx_m_s * STEP_S, y_m + vy_m_s * STEP_S

    def go(self, ahead: Place) -> None:
        """Walk on at the chosen velocity."""
        self.place = ahead

    def turn_round(self) -> None:
        """Walk the path the other way."""
        self._sign = -self._sign
        self._at_m += self._sign * 2.0 * AHEAD_M  # the point lay ahead of it, now behind
        self._since_s = 0.0
        self._velocity = (0.0, 0.0)
