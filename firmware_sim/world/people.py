"""People who walk about in a room and do not evade the robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from firmware_sim.errors import SimulationError
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.world import World

Contact: TypeAlias = Callable[[np.ndarray, float], tuple[float, float]]
"""Of a disc's middle in world and radius [m]: the robot's gap to it [m], and how fast the robot
moved towards it before the step [m/s]."""

RADIUS_M = 0.22
ROOM_M = 0.08
"""Room that they keep to walls [m]."""
SLOWEST_M_S, FASTEST_M_S = 0.5, 1.2
FROM_START_M = 1.5
"""Nobody begins nearer to the robot, where there is a place farther away [m]."""
CREEP_M_S = 0.05
"""A robot that moves towards a person faster than this runs into them."""
TOUCH_M = 2.0e-3
"""Gap at which robot and person touch [m]."""
PARTED_M = 0.05
"""Gap at which a contact is over [m]."""
STANDS_NS = 2_000_000_000
"""Time for which who has met the robot stands before they walk to somewhere else [ns]."""
SIDES = 12
STEP_NS = 10_000_000


@dataclass(slots=True)
class _Person:
    """One of them: where, on which way, how far along it [m], and until when they stand."""

    speed_m_s: float
    place: np.ndarray
    way: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    walked_m: float = 0.0
    stands_ns: int = 0
    touches: bool = False


class People:
    """Discs that walk at steady speeds from place to place, round walls, through each other.

    Who touches the robot stops, stands for two seconds and then walks to another place.

    Parameters
    ----------
    world
        The room with its obstacles; robots start at its start.
    count
        How many, >= 1.
    rng
        Draws speeds and places.

    Raises
    ------
    SimulationError
        If there is no place for them.

    Attributes
    ----------
    hit
        Contacts that the robot caused: it moved towards the person.
    ran_into
        Contacts that a person caused.
    """

    def __init__(self, world: World, count: int, rng: np.random.Generator) -> None:
        self._rng = rng
        self._space = FreeSpace(world, RADIUS_M + ROOM_M, world.start[:2])
        places = self._space.places
        if len(places) < 2:
            raise SimulationError(f"{world.name}: no room for people to walk")
        far = places[np.hypot(*(places - world.start[:2]).T) >= FROM_START_M]
        begin = far if len(far) else places
        self._people = [
            _Person(rng.uniform(SLOWEST_M_S, FASTEST_M_S), begin[rng.integers(len(begin))])
            for _ in range(count)
        ]
        self.hit = 0
        self.ran_into = 0
        angles = (np.arange(SIDES) + 0.5) * (2.0 * math.pi / SIDES)
        ring = RADIUS_M * np.column_stack([np.cos(angles), np.sin(angles)])
        self._sides = np.hstack([ring, np.roll(ring, -1, axis=0)])

    @property
    def discs(self) -> np.ndarray:
        """Middles and radii, (n, 3) [m]."""
        return np.array([(*each.place, RADIUS_M) for each in self._people])

    @property
    def places_m(self) -> tuple[tuple[float, float], ...]:
        """Where they are: x, y [m]."""
        return tuple((float(each.place[0]), float(each.place[1])) for each in self._people)

    @property
    def sides(self) -> np.ndarray:
        """What sensors see of them, (12 n, 4): sides from x, y to x, y [m]."""
        return np.vstack([self._sides + np.tile(each.place, 2) for each in self._people])

    def step(self, now_ns: int, contact: Contact) -> None:
        """Let `STEP_NS` pass until `now_ns`."""
        for person in self._people:
            gap_m, closing_m_s = contact(person.place, RADIUS_M)
            walks = now_ns >= person.stands_ns
            if walks:
                gap_m = self._walk(person, contact)
            if gap_m > PARTED_M:
                person.touches = False
            if gap_m > TOUCH_M:
                continue
            if walks:
                person.stands_ns = now_ns + STANDS_NS
                person.way = person.way[:0]
            if not person.touches:
                person.touches = True
                self.hit += closing_m_s > CREEP_M_S
                self.ran_into += closing_m_s <= CREEP_M_S

    def _walk(self, person: _Person, contact: Contact) -> float:
        """Let a person take a step, unless it led into the robot; return the gap [m]."""
        if not len(person.way):
            self._set_out(person)
        lengths_m = np.hypot(*np.diff(person.way, axis=0).T)
        walked_m = person.walked_m + person.speed_m_s * STEP_NS * 1e-9
        part = int(np.searchsorted(np.cumsum(lengths_m), walked_m))
        if part == len(lengths_m):
            person.way = person.way[:0]
            return contact(person.place, RADIUS_M)[0]
        share = (walked_m - float(lengths_m[:part].sum())) / lengths_m[part]
        place = person.way[part] + share * (person.way[part + 1] - person.way[part])
        gap_m, _ = contact(place, RADIUS_M)
        if gap_m > 0.0:
            person.place, person.walked_m = place, walked_m
        return gap_m

    def _set_out(self, person: _Person) -> None:
        """Let a person walk to another place."""
        places = self._space.places
        nearest = places[np.argmin(np.hypot(*(places - person.place).T))]
        there = nearest
        while np.array_equal(there, nearest):
            there = places[self._rng.integers(len(places))]
        person.way = np.vstack([person.place, self._space.way(nearest, there)])
        keep = np.hypot(*np.diff(person.way, axis=0).T) > 0.0
        person.way = person.way[np.concatenate([[True], keep])]
        person.walked_m = 0.0
