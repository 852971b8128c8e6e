"""People who walk in a room, each in a manner, and who runs into whom."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from firmware_sim.errors import SimulationError
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.manner import STUBBORN, Manner, deal
from firmware_sim.world.walking.walker import (
    LOOK_S,
    LOOK_STEPS,
    RADIUS_M,
    ROOM_M,
    STEP_NS,
    Mover,
    Place,
)
from firmware_sim.world.walking.walkers import WALKERS, Outset
from firmware_sim.world.world import World

Contact: TypeAlias = Callable[[Place, float], tuple[float, float]]
"""Maps a disc's middle in world and radius [m] to the robot's gap to it [m], and the robot's speed
towards it before the step [m/s]."""

Robot: TypeAlias = Callable[[], Mover]
"""Returns a disc that covers the robot."""

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


class People:
    """Discs that walk, each in a manner, through each other unless they evade.

    They are the people of the world, on their paths, and others, who walk from place to place round
    walls or where they like. A person who touches the robot stands for two seconds, then turns
    round.

    Parameters
    ----------
    world
        The room with its obstacles and people; robots start at its start.
    count
        Number of others, >= 0.
    rng
        Generator of speeds and places.
    manners
        Manners of the others, in turn.

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

    def __init__(
        self,
        world: World,
        count: int,
        rng: np.random.Generator,
        manners: tuple[Manner, ...] = STUBBORN,
    ) -> None:
        # Generators of their own, so that no manner changes the paths that this one draws.
        own, *streams = rng.spawn(1 + len(world.people) + count)
        known = [
            WALKERS[each.manner](
                Outset(
                    np.array([*each.points, each.points[0]]),
                    each.speed_m_s,
                    world,
                    stream,
                    stands_s=each.stands_s,
                )
            )
            for each, stream in zip(world.people, streams, strict=False)
        ]
        outsets = _outsets(world, rng, streams[len(known) :]) if count else []
        manners_of = deal(manners, count, own)
        others = (WALKERS[a](outset) for a, outset in zip(manners_of, outsets, strict=True))
        self._people = [*known, *others]
        self._seen = self.places_m
        """Places at the last look."""
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

    def step(self, now_ns: int, contact: Contact, robot: Robot | None = None) -> None:
        """Let `STEP_NS` pass until `now_ns`."""
        if now_ns // STEP_NS % LOOK_STEPS == 0:
            self._look(now_ns, robot)
        for person in self._people:
            before = person.place
            walks = now_ns >= person.stands_ns
            if walks:
                ahead = person.ahead()
                gap_m, _ = contact(ahead, RADIUS_M)
                if gap_m > 0.0:  # nobody walks into the robot
                    person.go(ahead)
            else:
                gap_m, _ = contact(before, RADIUS_M)
            if gap_m > PARTED_M:
                person.touches = False
            if gap_m > TOUCH_M:
                continue
            if walks and (gap_m <= 0.0 or not person.touches):
                person.stands_ns = now_ns + STANDS_NS
                person.turn_round()
            if not person.touches:
                person.touches = True
                _, closing_m_s = contact(before, RADIUS_M)
                self.hit += closing_m_s > CREEP_M_S
                self.ran_into += closing_m_s <= CREEP_M_S

    def _look(self, now_ns: int, robot: Robot | None) -> None:
        """Let all who look choose what to do, by where everybody is now."""
        if not any(each.looks for each in self._people):
            return
        places, seen = self.places_m, self._seen
        movers = [
            Mover(x, y, (x - was_x) / LOOK_S, (y - was_y) / LOOK_S, RADIUS_M, each.looks)
            for each, (x, y), (was_x, was_y) in zip(self._people, places, seen, strict=True)
        ]
        self._seen = places
        robots = () if robot is None else (robot(),)
        for number, person in enumerate(self._people):
            if person.looks and now_ns >= person.stands_ns:
                person.look([*movers[:number], *movers[number + 1 :], *robots])


def _outsets(
    world: World, rng: np.random.Generator, streams: Sequence[np.random.Generator]
) -> list[Outset]:
    """Return what people who walk from place to place begin with."""
    space = FreeSpace(world, RADIUS_M + ROOM_M, world.start[:2])
    far = np.hypot(*(space.places - world.start[:2]).T) >= FROM_START_M
    begins = space.places[far] if far.any() else space.places
    if len(space.places) < PLACES:
        raise SimulationError(f"{world.name}: no room for people to walk")
    return [
        Outset(
            _round(space, begins, rng),
            rng.uniform(SLOWEST_M_S, FASTEST_M_S),
            world,
            stream,
            space,
        )
        for stream in streams
    ]


def _round(space: FreeSpace, begins: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a closed path over some places, (k, 2) [m]."""
    others = space.places[rng.choice(len(space.places), PLACES - 1, replace=False)]
    places = [begins[rng.integers(len(begins))], *others]
    ways = [space.way(*each) for each in zip(places, [*others, places[0]], strict=True)]
    return np.vstack(ways)
