"""People who walk in a room and do not avoid the robot."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from firmware_sim.errors import SimulationError
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.world import World

Place: TypeAlias = tuple[float, float]
"""Place in world: x, y [m]."""

Contact: TypeAlias = Callable[[Place, float], tuple[float, float]]
"""Maps a disc's middle in world and radius [m] to the robot's gap to it [m], and the robot's speed
towards it before the step [m/s]."""

RADIUS_M = 0.22
ROOM_M = 0.08
"""Clearance that people keep from walls [m]."""
SLOWEST_M_S, FASTEST_M_S = 0.5, 1.2
FROM_START_M = 1.5
"""Minimum distance of a person from the robot at the start, if there is room for it [m]."""
CREEP_M_S = 0.05
"""Speed towards a person above which the robot causes the contact [m/s]."""
TOUCH_M = 2.0e-3
"""Gap at which robot and person touch [m]."""
PARTED_M = 0.05
"""Gap at which a contact is over [m]."""
STANDS_NS = 2_000_000_000
"""Time for which a person who met the robot stands before turning round [ns]."""
PLACES = 6
"""Number of places that each person visits in turn."""
SIDES = 12
STEP_NS = 10_000_000


class _Person:
    """One person: a closed path, and the distance walked along it.

    Paths are planned before a run begins, so that it never waits for them. `place` is where that
    distance ends.
    """

    __slots__ = (
        "_corners", "_lengths_m", "at_m", "place", "sign", "speed_m_s", "stands_ns", "touches",
    )  # fmt: skip

    def __init__(self, round_m: np.ndarray, speed_m_s: float) -> None:
        lengths_m = np.hypot(*np.diff(round_m, axis=0).T).cumsum()
        self._lengths_m: list[float] = [0.0, *lengths_m.tolist()]
        self._corners: list[Place] = [(x, y) for x, y in round_m.tolist()]
        self.speed_m_s = speed_m_s
        self.at_m = 0.0
        self.place = self.along(0.0)
        self.sign = 1.0
        self.stands_ns = 0
        self.touches = False

    def along(self, at_m: float) -> Place:
        """Return a place on the path."""
        lengths_m = self._lengths_m
        whole_m = lengths_m[-1]
        at_m = at_m % whole_m % whole_m  # twice: -1e-20 % 5.0 is 5.0
        after = bisect_right(lengths_m, at_m)
        side_m, into_m = lengths_m[after] - lengths_m[after - 1], at_m - lengths_m[after - 1]
        (x, y), (next_x, next_y) = self._corners[after - 1], self._corners[after]
        return (next_x - x) / side_m * into_m + x, (next_y - y) / side_m * into_m + y

    @property
    def next_m(self) -> float:
        """Distance along the path after the next step [m]."""
        return self.at_m + self.sign * self.speed_m_s * STEP_NS * 1e-9


class People:
    """Discs that walk at steady speeds, through each other.

    They are the people of the world, on their paths, and others from place to place, round walls. A
    person who touches the robot stands for two seconds, then turns round.

    Parameters
    ----------
    world
        The room with its obstacles and people; robots start at its start.
    count
        Number of others, >= 0.
    rng
        Generator of speeds and places.

    Raises
    ------
    SimulationError
        If there is no room for them.

    Attributes
    ----------
    hit
        Contacts that the robot caused: it moved towards the person.
    ran_into
        Contacts that a person caused.
    """

    def __init__(self, world: World, count: int, rng: np.random.Generator) -> None:
        self._people = [
            _Person(np.array([*each.points, each.points[0]]), each.speed_m_s)
            for each in world.people
        ]
        self._people += _walkers(world, count, rng) if count else ()
        self.hit = 0
        self.ran_into = 0
        angles = (np.arange(SIDES) + 0.5) * (2.0 * math.pi / SIDES)
        ring = RADIUS_M * np.column_stack([np.cos(angles), np.sin(angles)])
        self._sides = np.hstack([ring, np.roll(ring, -1, axis=0)])

    @property
    def discs(self) -> np.ndarray:
        """Centres and radii, (n, 3) [m]."""
        return np.array([(*each.place, RADIUS_M) for each in self._people])

    @property
    def places_m(self) -> tuple[Place, ...]:
        """All places."""
        return tuple(each.place for each in self._people)

    @property
    def sides(self) -> np.ndarray:
        """Sides that sensors see, (12 n, 4): from x, y to x, y [m]."""
        places = np.array([each.place * 2 for each in self._people])
        sides: np.ndarray = (self._sides + places[:, np.newaxis]).reshape(-1, 4)
        return sides

    def step(self, now_ns: int, contact: Contact) -> None:
        """Let `STEP_NS` pass until `now_ns`."""
        for person in self._people:
            before = person.place
            walks = now_ns >= person.stands_ns
            if walks:
                ahead = person.along(person.next_m)
                gap_m, _ = contact(ahead, RADIUS_M)
                if gap_m > 0.0:  # nobody walks into the robot
                    person.at_m, person.place = person.next_m, ahead
            else:
                gap_m, _ = contact(before, RADIUS_M)
            if gap_m > PARTED_M:
                person.touches = False
            if gap_m > TOUCH_M:
                continue
            if walks and (gap_m <= 0.0 or not person.touches):
                person.stands_ns = now_ns + STANDS_NS
                person.sign = -person.sign
            if not person.touches:
                person.touches = True
                _, closing_m_s = contact(before, RADIUS_M)
                self.hit += closing_m_s > CREEP_M_S
                self.ran_into += closing_m_s <= CREEP_M_S


def _walkers(world: World, count: int, rng: np.random.Generator) -> list[_Person]:
    """Return people who walk from place to place."""
    space = FreeSpace(world, RADIUS_M + ROOM_M, world.start[:2])
    far = np.hypot(*(space.places - world.start[:2]).T) >= FROM_START_M
    begins = space.places[far] if far.any() else space.places
    if len(space.places) < PLACES:
        raise SimulationError(f"{world.name}: no room for people to walk")
    return [
        _Person(_round(space, begins, rng), rng.uniform(SLOWEST_M_S, FASTEST_M_S))
        for _ in range(count)
    ]


def _round(space: FreeSpace, begins: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a closed path over some places, (k, 2) [m]."""
    others = space.places[rng.choice(len(space.places), PLACES - 1, replace=False)]
    places = [begins[rng.integers(len(begins))], *others]
    ways = [space.way(*each) for each in zip(places, [*others, places[0]], strict=True)]
    return np.vstack(ways)
