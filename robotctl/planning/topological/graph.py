"""A topological map: places and the passages between them.

A way needs no coordinates: a place lists its passages counter-clockwise, so "the second passage to
the left of the one you came through" leads on. Where coordinates are known they are kept beside it.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class TopologicalPlace:
    """A room, a corridor or an open area.

    Parameters
    ----------
    name
        Unique in its map.
    kind
        `corridor` if it is three times as long as wide, or longer.
    passages
        Names of its passages, counter-clockwise around its widest spot.
    area_m2, width_m
        Of its free floor, and the diameter of the largest circle in it.
    depth_m
        How far one sees from where it is widest and a robot can stand, for equal steps of bearing
        counter-clockwise from x of the map: what it looks like to a sensor.
    x_m, y_m
        That spot, nan if unknown.
    """

    name: str
    kind: Literal["room", "corridor"]
    passages: tuple[str, ...]
    area_m2: float
    width_m: float
    depth_m: tuple[float, ...] = ()
    x_m: float = math.nan
    y_m: float = math.nan


@dataclass(frozen=True, slots=True)
class Passage:
    """A door or an opening between two places.

    Parameters
    ----------
    name
        Unique in its map.
    between
        Names of the places.
    width_m
        Of its narrowest spot.
    length_m
        From the widest spot of one place through it to that of the other.
    x_m, y_m
        Its narrowest spot, nan if unknown.
    """

    name: str
    between: tuple[str, str]
    width_m: float
    length_m: float
    x_m: float = math.nan
    y_m: float = math.nan


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a way.

    Parameters
    ----------
    passage
        To go through.
    left
        Counted to the left from the passage through which one came in: 1 is the next one
        clockwise around the place, as seen when coming in. None at the start.
    of
        How many passages the place has.
    place
        Where that leads.
    """

    passage: Passage
    left: int | None
    of: int
    place: TopologicalPlace


@dataclass(frozen=True)
class TopologicalMap:
    """Places and passages.

    Raises
    ------
    InvalidValue
        If a name is not unique, or a place and a passage do not agree.
    """

    places: tuple[TopologicalPlace, ...]
    passages: tuple[Passage, ...]

    def __post_init__(self) -> None:
        for key, named in (("place", self.places), ("passage", self.passages)):
            names = [each.name for each in named]
            for name in names:
                if not name or names.count(name) > 1:
                    raise InvalidValue(f"{key}.name", f"must be unique, found {name!r}", name)
        listed = sorted((each, place.name) for place in self.places for each in self._known(place))
        joined = sorted((each.name, name) for each in self.passages for name in each.between)
        if listed != joined:
            wrong = sorted(set(listed) ^ set(joined)) or listed
            raise InvalidValue(
                "place.passages",
                f"and passage.between disagree on passage {wrong[0][0]!r} of {wrong[0][1]!r}",
                wrong,
            )

    def _known(self, place: TopologicalPlace) -> Iterator[str]:
        """Yield the passages of a place, which must be known."""
        for name in place.passages:
            if not any(each.name == name for each in self.passages):
                raise InvalidValue("place.passages", f"must be known, found {name!r}", name)
            yield name

    def place(self, name: str) -> TopologicalPlace | None:
        """Return the place of a name, None if there is none."""
        return next((each for each in self.places if each.name == name), None)

    def renamed(self, old: str, new: str) -> TopologicalMap:
        """Return the map with another name for a place.

        Raises
        ------
        InvalidValue
            If another place has it.
        """
        places = [replace(each, name=new) if each.name == old else each for each in self.places]
        passages = [
            replace(each, between=(new if a == old else a, new if b == old else b))
            for each in self.passages
            for a, b in (each.between,)
        ]
        return TopologicalMap(tuple(places), tuple(passages))

    def way(self, start: str, goal: str) -> list[Step] | None:
        """Return the shortest way between two places, None if there is none (Dijkstra 1959)."""
        waiting: list[tuple[float, int, str, list[Passage]]] = [(0.0, 0, start, [])]
        settled: set[str] = set()
        pushed = 0
        while waiting:
            length_m, _, here, through = heapq.heappop(waiting)
            if here == goal:
                return list(self._steps(start, through))
            if here in settled:
                continue
            settled.add(here)
            for passage in self.passages:
                if here in passage.between:
                    pushed += 1
                    there = _beyond(passage, here)
                    further = (length_m + passage.length_m, pushed, there, [*through, passage])
                    heapq.heappush(waiting, further)
        return None

    def _steps(self, start: str, through: list[Passage]) -> Iterator[Step]:
        by_name = {each.name: each for each in self.places}
        here, came = by_name[start], None
        for passage in through:
            n = len(here.passages)
            left = None
            if came is not None:
                # Coming in, the next passage to the left is the one before in the order.
                at = here.passages.index
                left = (at(came.name) - at(passage.name)) % n
            there = by_name[_beyond(passage, here.name)]
            yield Step(passage, left, n, there)
            here, came = there, passage


def _beyond(passage: Passage, here: str) -> str:
    a, b = passage.between
    return b if here == a else a
