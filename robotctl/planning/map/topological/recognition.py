"""Recognition of the place of a topological map in which a scan was taken, and of the pose in it.

What the views of a place show together is its appearance. A scan is laid over it by correlative
search (Olson, ICRA 2009) and judged by the nearest views: what one sees, the other must not have
looked through.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.slam.front_end.agreement import ScanView as Sight
from robotctl.estimation.slam.front_end.agreement import agreement, view_of
from robotctl.estimation.slam.front_end.correlative import Window
from robotctl.estimation.slam.front_end.surface import Floats, Surface, joined, surface_of
from robotctl.estimation.slam.keyframes.keyframe import LOOSE
from robotctl.estimation.slam.keyframes.local_map import map_of, thinned
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.topological.appearance import REACH_M, SPACING_M
from robotctl.planning.map.topological.graph import TopologicalMap, TopologicalPlace, spot

POINTS: Final = 120
"""Number of points of a scan that are compared."""
_ASKED: Final = 2
"""Number of views near a pose that judge it."""
_LEAST_SCORE: Final = 0.5
_LEAST_AGREES: Final = 0.85
"""Minimum score of a place that the scan may be from, and share of the scan that agrees."""
_ALIKE: Final = 0.9
"""Share of the best place's score and agreement from which another one makes it ambiguous."""
_FOLLOW_SCORE: Final = 0.5
_FOLLOW_AGREES: Final = 0.75
"""The same near the expected pose, where less is required: boxes and people stand about."""
_SPOT_M: Final = 0.5
"""Maximum distance between sightings of one spot from two places [m]."""
_SHIFT_M: Final = 0.4
_TURN_RAD: Final = 0.2
"""Half sides of the search window around the expected pose [m], [rad]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sighting(Candidate[str]):
    """A scan laid over a place; the score is the share of it that lies on what is seen there.

    Parameters
    ----------
    agrees
        Share of the points seen by both scan and views on which they agree, 0 to 1.
    """

    agrees: float


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A scan, prepared for comparisons."""

    surface: Surface
    points: Floats
    sight: Sight


def look_of(scan: RangeScan) -> Look | None:
    """Return a scan for comparisons; None: it has no echo."""
    surface = surface_of(scan)
    if len(surface.points) == 0:
        return None
    return Look(surface, thinned(surface.points, POINTS), view_of(scan))


class Appearance:
    """Appearance of a place, in its frame.

    Parameters
    ----------
    place
        With its depths.
    """

    def __init__(self, place: TopologicalPlace) -> None:
        seen = [((0.0, 0.0), place.depth_m)]
        seen += [(spot(view), view.depth_m) for view in place.view]
        self.name = place.name
        self.spots = np.array([at for at, _ in seen])
        scans = [_scan(at, depth_m) for at, depth_m in seen]
        self._sights = [view_of(each) for each in scans]
        self._surfaces = [surface_of(each) for each in scans]
        self._map = map_of(joined(self._surfaces))

    def find(self, look: Look, window: Window, least: float) -> Sighting | None:
        """Return where in a window a scan fits best; None: nowhere better than `least`."""
        fit = self._map.fit(look.surface, look.points, window, least, LOOSE)
        if fit is None:
            return None
        pose = fit.match.pose
        return Sighting(self.name, pose, fit.score, agrees=self._agrees(look, pose))

    def follow(self, look: Look, expected: SE2, doubt_m: float) -> Sighting | None:
        """Return where a scan was taken, near where it should be; None: it does not fit there.

        Parameters
        ----------
        look
            The scan.
        expected
            Pose of `base` in the frame of the place.
        doubt_m
            Error that it may have beside the usual one [m].
        """
        window = Window(expected, _SHIFT_M + doubt_m, _TURN_RAD, _SHIFT_M + doubt_m, _TURN_RAD)
        found = self.find(look, window, _FOLLOW_SCORE)
        return found if found is not None and found.agrees >= _FOLLOW_AGREES else None

    def windows(self) -> list[Window]:
        """Return what covers the place: around each spot one window for each quarter turn."""
        half_m, eighth_rad = 0.8 * SPACING_M, 0.25 * math.pi
        return [
            Window(SE2(x_m, y_m, 2.0 * quarter * eighth_rad), half_m, eighth_rad)
            for x_m, y_m in self.spots.tolist()
            for quarter in range(4)
        ]

    def _agrees(self, look: Look, pose: SE2) -> float:
        """Return how far the views near a pose and a scan from there bear each other out."""
        away_m = np.hypot(*(self.spots - (pose.x_m, pose.y_m)).T)
        asked = np.argsort(away_m)[:_ASKED].tolist()
        shares = []
        for each in asked:
            there = agreement(self._sights[each], look.surface, pose).of_seen
            back = agreement(look.sight, self._surfaces[each], pose.inverse()).of_seen
            shares.append(min(there, back))
        return max(shares)


def _scan(at: tuple[float, float], depth_m: tuple[float, ...]) -> RangeScan:
    """Return what is seen from a spot as a scan; `base` is the frame of the place."""
    depths = np.array(depth_m)
    ranges = np.where(depths < REACH_M, depths, np.inf)
    angles = np.linspace(0.0, math.tau, len(ranges), endpoint=False)
    return RangeScan(0, angles, ranges, REACH_M, *at)


class PlaceSearch:
    """Searches for the place of a scan; a robot that drives does so a window in each step.

    Parameters
    ----------
    places
        Places of the map that are compared.
    topology
        The map.
    """

    def __init__(self, places: Sequence[Appearance], topology: TopologicalMap) -> None:
        self._places = places
        self._map = topology

    def suggest(self, sensed: Look) -> Recognition[Sighting]:
        """Return the places that a scan may be from, and why none is recognised."""
        return next(each for each in self.steps(sensed) if each is not None)

    def steps(self, sensed: Look) -> Iterator[Recognition[Sighting] | None]:
        """Search a window in each step; yield None until all are searched."""
        left = [(place, window) for place in self._places for window in place.windows()]
        best: dict[str, Sighting] = {}
        while left:
            place, window = left.pop()
            most = max((each.score for each in best.values()), default=0.0)
            seen = place.find(sensed, window, max(0.6 * _LEAST_SCORE, 0.8 * most))
            before = best.get(place.name)
            if seen is not None and (before is None or seen.score > before.score):
                best[place.name] = seen
            if left:
                yield None
        yield self._judged(sorted(best.values(), key=lambda each: each.score, reverse=True))

    def _judged(self, ranked: Sequence[Sighting]) -> Recognition[Sighting]:
        """Return the likely places among the best sightings of each, and whether one stands out."""
        likely = [
            each for each in ranked if each.score >= _LEAST_SCORE and each.agrees >= _LEAST_AGREES
        ]
        if not likely:
            what = f"{ranked[0].place} looks least unlike" if ranked else "none looks like it"
            return Recognition((), f"this is no place of the map: {what}")
        best = max(likely, key=lambda each: each.score * each.agrees)
        alike = [
            each.place
            for each in likely
            if each.score >= _ALIKE * best.score
            and each.agrees >= _ALIKE * best.agrees
            and not self._is_same(best, each)
        ]
        candidates = (best, *(each for each in likely if each is not best))
        if alike:
            reason = f"from here {' and '.join([best.place, *alike])} look alike"
            return Recognition(candidates, reason)
        return Recognition(candidates)

    def _is_same(self, one: Sighting, other: Sighting) -> bool:
        """Return whether two sightings are of one spot, beside an open passage of both places."""
        if one.place == other.place:
            return True
        for passage in self._map.passages:
            if {one.place, other.place} == set(passage.between):
                T_one_other = self._map.across(one.place, passage)
                off = one.pose.inverse() @ T_one_other @ other.pose
                if math.hypot(off.x_m, off.y_m) < _SPOT_M and abs(off.theta_rad) < _TURN_RAD:
                    return True
        return False


def appearances(topology: TopologicalMap) -> dict[str, Appearance]:
    """Return what all places look like, by name, with all code compiled that compares."""
    result = {place.name: Appearance(place) for place in topology.places}
    for place in topology.places[:1]:
        look = look_of(_scan((0.0, 0.0), place.depth_m))
        if look is not None:
            result[place.name].follow(look, SE2(), 0.0)
    return result
