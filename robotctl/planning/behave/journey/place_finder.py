"""Finding the place that the robot is in, by what its lidar sees."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from robotctl.estimation.places.recogniser import Recognition
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    failed,
)
from robotctl.planning.behave.journey.blindness import BlindWait
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.map.topological.graph import TopologicalMap
from robotctl.planning.map.topological.recognition import (
    Appearance,
    PlaceSearch,
    Sighting,
    appearances,
    look_of,
)
from robotctl.words import counted

_WINDOWS: Final = 4
"""Windows searched in a step, if there is time."""
_STANDS_M_S: Final = 0.02
_STANDS_RAD_S: Final = 0.05
"""Velocities below which the robot stands, so that its scan is sharp [m/s, rad/s]."""


@dataclass(slots=True)
class Belief:
    """Belief of where the robot is.

    Parameters
    ----------
    place
        Its name.
    T_world_frame
        The frame of the place; `world` is that of the behaviour's poses.
    is_borne_out
        Whether a scan has fitted.
    unseen_m
        Way since the last scan that did, or since it came there [m].
    """

    place: str
    T_world_frame: SE2
    is_borne_out: bool
    unseen_m: float = 0.0


class KnownPlaces:
    """The places that a robot can drive to.

    Parameters
    ----------
    topology
        Their map.
    """

    def __init__(self, topology: TopologicalMap) -> None:
        self.map = topology

    @cached_property
    def looks(self) -> Mapping[str, Appearance]:
        """Appearance of each place, by name; its first use compiles the kernels."""
        return appearances(self.map)


class PlaceFinder:
    """Stands and searches for the place; where nothing is recognised, drives on and looks again.

    Parameters
    ----------
    tools
        World and paths.
    places
        The places that there are.
    roam
        Makes what drives to where more is to be seen.
    start
        Place to look in first; empty: any.
    blind
        Waits while nothing is seen.

    Attributes
    ----------
    reason
        Why the place is unknown, for people.
    """

    def __init__(
        self,
        tools: JourneyTools,
        places: KnownPlaces,
        roam: Callable[[], Behaviour],
        start: str,
        blind: BlindWait,
    ) -> None:
        self._tools = tools
        self._config = tools.journey.travel
        self._places = places
        self._make_roam = roam
        self._start = start
        self._blind = blind
        self.reset()

    def reset(self) -> None:
        """Start over."""
        self._hint = self._start
        self._looks = 0
        self.reason = ""
        self.pause()

    def pause(self) -> None:
        """Restart the search after the pause."""
        self._search: tuple[Iterator[Recognition[Sighting] | None], SE2] | None = None
        self._roam: tuple[Behaviour, int] | None = None
        self._roamed_m = 0.0

    def note_driven(self, driven_m: float) -> None:
        """Count a distance driven [m]."""
        self._roamed_m += driven_m

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | Belief:
        """Return the next velocity, or the place once it is found."""
        if self._roam is not None:
            return self._roam_on(*self._roam, situation, now_ns)
        if self._search is None:
            return self._begin_search(situation, now_ns)
        search, T_world_base = self._search
        for _ in range(_WINDOWS):
            recognition = next(search)
            if recognition is not None:
                return self._end_search(recognition, T_world_base, now_ns)
            if not self._tools.paths.has_time:
                break
        return BehaviourOutput(0.0, 0.0, text="looking where it is")

    def _begin_search(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Take a scan to search with, once the robot stands."""
        twist, taken = situation.twist, self._tools.world.last_scan
        stands = abs(twist.v_m_s) < _STANDS_M_S and abs(twist.omega_rad_s) < _STANDS_RAD_S
        look = None if taken is None else look_of(taken[1])
        if taken is None or look is None:
            return self._blind.step("no echo of a lidar comes to recognise places by", now_ns)
        self._blind.end()
        if stands:
            if self._looks >= self._config.searches:
                return failed(f"gave up after {counted(self._looks, 'look')} around: {self.reason}")
            self._looks += 1
            names = [self._hint] if self._hint else list(self._places.looks)
            places = [self._places.looks[name] for name in names]
            self._search = PlaceSearch(places, self._places.map).steps(look), taken[0]
        return BehaviourOutput(0.0, 0.0, text="standing, to look where it is")

    def _end_search(
        self, recognition: Recognition[Sighting], T_world_base: SE2, now_ns: int
    ) -> BehaviourOutput | Belief:
        """Believe what was found; after nothing, look at other places or elsewhere."""
        self._search = None
        hint, self._hint = self._hint, ""
        found = recognition.found
        if found is not None:
            T_world_frame = T_world_base @ found.pose.inverse()
            return Belief(found.place, T_world_frame, is_borne_out=True)
        self.reason = f"this does not look like {hint}" if hint else recognition.refusal
        if not hint:
            self._roam = self._make_roam(), now_ns
            self._roamed_m = 0.0
        return BehaviourOutput(0.0, 0.0, text=self.reason)

    def _roam_on(
        self, roaming: Behaviour, begin_ns: int, situation: BehaviourInput, now_ns: int
    ) -> BehaviourOutput:
        """Drive to where more is to be seen."""
        step = roaming.step(situation, now_ns)
        config = self._config
        enough = self._roamed_m > config.roam_m or now_ns - begin_ns > round(1e9 * config.roam_s)
        if enough or step.status is not Status.RUNNING:
            self._roam = None
            return BehaviourOutput(0.0, 0.0, text=self.reason)
        return step._replace(text=f"{self.reason}; driving on to see more")
