"""A topological map: places and the passages between them.

A way needs no coordinates: a place lists its passages counter-clockwise, so "the second passage to
the left of the one you came through" leads on. What a robot needs to drive it, too, each place says
in a frame of its own: its middle, and the direction of its first passage. No frame is common to two
places. Where coordinates of a map are known they are kept beside it, for people.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from robotctl.errors import InvalidValue
from robotctl.model.geometry.se2 import SE2

PlaceKind = Literal["room", "corridor", "junction"]


@dataclass(frozen=True, slots=True)
class Exit:
    """Passage as seen in the frame of a place.

    Parameters
    ----------
    passage
        Its name.
    bearing_deg, distance_m
        From the middle of the place.
    heading_deg
        Of one who leaves the place through it.
    """

    passage: str
    bearing_deg: float
    distance_m: float
    heading_deg: float


@dataclass(frozen=True, slots=True)
class PlaceView:
    """Appearance of a place from a spot other than its middle, in the frame of the place.

    Parameters
    ----------
    bearing_deg, distance_m
        The spot, from the middle.
    depth_m
        As that of the place.
    """

    bearing_deg: float
    distance_m: float
    depth_m: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TopologicalPlace:
    """A room, a corridor, an open area, or where corridors meet.

    Parameters
    ----------
    name
        Unique in its map.
    kind
        `corridor` if it is three times as long as wide, or longer, or leads off a `junction`.
    passages
        Names of its passages, counter-clockwise around its widest spot.
    area_m2, width_m
        Of its free floor, and the diameter of the largest circle in it.
    depth_m
        How far one sees from its middle, where it is widest and a robot can stand, for equal steps
        of bearing counter-clockwise from its first passage: what it looks like to a sensor. As far
        as `REACH_M`: at least.
    exit
        Its passages, in that order; empty if it is not known where they are.
    view
        What it looks like from elsewhere.
    x_m, y_m
        Its middle, nan if unknown.

    Raises
    ------
    InvalidValue
        If there are exits, but not those of its passages.
    """

    name: str
    kind: PlaceKind
    passages: tuple[str, ...]
    area_m2: float
    width_m: float
    depth_m: tuple[float, ...] = ()
    exit: tuple[Exit, ...] = ()
    view: tuple[PlaceView, ...] = ()
    x_m: float = math.nan
    y_m: float = math.nan

    def __post_init__(self) -> None:
        found = tuple(each.passage for each in self.exit)
        if found and found != self.passages:
            wanted = ", ".join(self.passages)
            raise InvalidValue(
                "exit", f"of {self.name}: {', '.join(found)} found; needed: {wanted}", found
            )

    def way_out(self, passage: str) -> SE2:
        """Return the pose of one who leaves through a passage, in the frame of the place."""
        found = next(each for each in self.exit if each.passage == passage)
        x_m, y_m = spot(found)
        return SE2(x_m, y_m, math.radians(found.heading_deg))


def spot(item: Exit | PlaceView) -> tuple[float, float]:
    """Return where something is in the frame of its place [m]."""
    bearing_rad = math.radians(item.bearing_deg)
    return item.distance_m * math.cos(bearing_rad), item.distance_m * math.sin(bearing_rad)


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

    def beyond(self, here: str) -> str:
        """Return the place on the other side of it than one of its places."""
        a, b = self.between
        return b if here == a else a


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
    length_m
        Of the way so far, to the middle of `place`.
    """

    passage: Passage
    left: int | None
    of: int
    place: TopologicalPlace
    length_m: float


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

    def across(self, here: str, passage: Passage) -> SE2:
        """Return the frame of the place beyond a passage in that of the place `here`."""
        by_name = {place.name: place for place in self.places}
        way_in = by_name[passage.beyond(here)].way_out(passage.name)
        return by_name[here].way_out(passage.name) @ SE2(0.0, 0.0, math.pi) @ way_in.inverse()

    @property
    def undrivable(self) -> str:
        """Why a robot cannot drive by it; empty if it can."""
        for place in self.places:
            if not place.depth_m or len(place.exit) < len(place.passages):
                return f"it does not say what {place.name} looks like and where its exits are"
        return ""

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

    def way(
        self, start: str, goal: str, without: frozenset[str] = frozenset()
    ) -> list[Step] | None:
        """Return the shortest way between two places, None if there is none (Dijkstra 1959).

        It leads from the middle of one through passages to that of the other, straight from passage
        to passage. Passages whose names are in `without` are closed.
        """
        if start == goal:
            return []
        waiting: list[tuple[float, int, str, bool, list[Passage]]] = [(0.0, 0, start, False, [])]
        settled: set[tuple[str, str]] = set()
        pushed = 0
        while waiting:
            length_m, _, here, has_arrived, through = heapq.heappop(waiting)
            if has_arrived:
                return list(self._steps(start, through))
            came = through[-1].name if through else ""
            if (here, came) in settled:
                continue
            settled.add((here, came))
            for name, leg_m in self._legs_m[here, came].items():
                if name in without or (not name and here != goal):
                    continue
                pushed += 1
                on = [self._by_name[name]] if name else []
                there = on[0].beyond(here) if on else here
                further = (length_m + leg_m, pushed, there, not on, [*through, *on])
                heapq.heappush(waiting, further)
        return None

    @cached_property
    def _by_name(self) -> dict[str, Passage]:
        return {each.name: each for each in self.passages}

    @cached_property
    def _legs_m(self) -> dict[tuple[str, str], dict[str, float]]:
        """Distances within places, from each passage to each other; "" is the middle [m]."""
        result: dict[tuple[str, str], dict[str, float]] = {}
        for place in self.places:
            ends = {"": (0.0, 0.0)} | {each.passage: spot(each) for each in place.exit}
            for a in ("", *place.passages):
                for b in ("", *place.passages):
                    if place.exit:
                        leg_m = math.dist(ends[a], ends[b])
                    else:  # half of each passage lies in each of its places
                        leg_m = sum(0.5 * self._by_name[each].length_m for each in (a, b) if each)
                    result.setdefault((place.name, a), {})[b] = leg_m
        return result

    def _steps(self, start: str, through: list[Passage]) -> Iterator[Step]:
        by_name = {each.name: each for each in self.places}
        here, came, way_m = by_name[start], "", 0.0
        for passage in through:
            n = len(here.passages)
            left = None
            if came:
                # Coming in, the next passage to the left is the one before in the order.
                at = here.passages.index
                left = (at(came) - at(passage.name)) % n
            way_m += self._legs_m[here.name, came][passage.name]
            here, came = by_name[passage.beyond(here.name)], passage.name
            yield Step(passage, left, n, here, way_m + self._legs_m[here.name, came][""])
