"""Recognition of the place of a topological map in which a scan was taken, and of the pose in it.

What the views of a place show together is its appearance. A scan is laid over it by correlative
search (Olson, ICRA 2009) and judged by the nearest views: what one sees, the other must not have
looked through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.agreement import View as Sight
from robotctl.estimation.slam.front_end.agreement import agreement, view_of
from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import Bins, binned, refine
from robotctl.estimation.slam.front_end.score_field import ScoreField, score_field
from robotctl.estimation.slam.front_end.surface import Floats, Surface, joined, surface_of
from robotctl.estimation.slam.keyframes.keyframe import LOOSE
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.topological.appearance import REACH_M, SPACING_M
from robotctl.planning.map.topological.graph import TopologicalMap, TopologicalPlace, spot

POINTS: Final = 120
"""Number of points of a scan that are compared."""
_ASKED: Final = 2
"""Views near a pose that judge it."""
_LEAST_SCORE: Final = 0.5
_LEAST_AGREES: Final = 0.85
"""Minimum score, and share of the scan that agrees, of a place that the scan may be from."""
_ALIKE: Final = 0.9
"""Another place with this share of the score, and of what agrees, leaves it open which it is."""
_FOLLOW_SCORE: Final = 0.5
_FOLLOW_AGREES: Final = 0.75
"""The same near where a robot should be: boxes stand about, and people."""
_SPOT_M: Final = 0.5
"""Sightings of two places that are no farther apart are of one spot."""
_SHIFT_M: Final = 0.4
_TURN_RAD: Final = 0.2
"""Around where a robot should be: to each side."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A scan laid over a place.

    Parameters
    ----------
    place
        Its name.
    pose
        Of `base` in its frame.
    score
        How much of the scan lies on what is seen there, 0 to 1.
    agrees
        Of what scan and views say of each other, the share that agrees, 0 to 1.
    """

    place: str
    pose: SE2
    score: float
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
    points = surface.points
    if len(points) == 0:
        return None
    if len(points) > POINTS:
        points = points[np.linspace(0, len(points) - 1, POINTS).astype(np.int64)]
    return Look(surface, points, view_of(scan))


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
        whole = joined(self._surfaces)
        self._field: ScoreField = score_field(whole.outline)
        self._bins: Bins = binned(whole)

    def find(self, look: Look, window: Window, least: float) -> Sighting | None:
        """Return where in a window a scan fits best; None: nowhere better than `least`."""
        found = search(self._field, look.points, window, least)
        if found is None:
            return None
        pose = refine(self._bins, look.surface, found.pose, found.pose, LOOSE).pose
        return Sighting(self.name, pose, found.score, self._agrees(look, pose))

    def follow(self, look: Look, expected: SE2, doubt_m: float) -> Sighting | None:
        """Return where a scan was taken, near where it should be; None: it does not fit there.

        Parameters
        ----------
        look
            The scan.
        expected
            Pose of `base` in the frame of the place.
        doubt_m
            How far off that may be, beside the usual [m].
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
            there = agreement(
                self._sights[each], look.surface.points, look.surface.weights, pose
            ).of_seen
            surface = self._surfaces[each]
            back = agreement(look.sight, surface.points, surface.weights, pose.inverse()).of_seen
            shares.append(min(there, back))
        return max(shares)


def _scan(at: tuple[float, float], depth_m: tuple[float, ...]) -> RangeScan:
    """Return what is seen from a spot as a scan; `base` is the frame of the place."""
    depths = np.array(depth_m)
    ranges = np.where(depths < REACH_M, depths, np.inf)
    angles = np.linspace(0.0, math.tau, len(ranges), endpoint=False)
    return RangeScan(0, angles, ranges, REACH_M, *at)


class PlaceSearch:
    """Looks for the place of a scan, a window in each step.

    Parameters
    ----------
    look
        The scan.
    places
        Where it may be from.
    topology
        Their map.

    Attributes
    ----------
    found
        When it is over: the place; None: none, or more than one.
    reason
        Why none was found.
    """

    def __init__(self, look: Look, places: Sequence[Appearance], topology: TopologicalMap) -> None:
        self._look = look
        self._map = topology
        self._left = [(place, window) for place in places for window in place.windows()]
        self._best: dict[str, Sighting] = {}
        self.found: Sighting | None = None
        self.reason = ""

    def step(self) -> bool:
        """Search one window; return whether the search is over."""
        if self._left:
            place, window = self._left.pop()
            best = max((each.score for each in self._best.values()), default=0.0)
            seen = place.find(self._look, window, max(0.6 * _LEAST_SCORE, 0.8 * best))
            if seen is not None and seen.score > _score(self._best.get(place.name)):
                self._best[place.name] = seen
        if self._left:
            return False
        self._judge()
        return True

    def _judge(self) -> None:
        """Decide which place it is."""
        ranked = sorted(self._best.values(), key=lambda each: each.score, reverse=True)
        likely = [
            each for each in ranked if each.score >= _LEAST_SCORE and each.agrees >= _LEAST_AGREES
        ]
        if not likely:
            what = f"{ranked[0].place} looks least unlike" if ranked else "none looks like it"
            self.reason = f"this is no place of the map: {what}"
            return
        best = max(likely, key=lambda each: each.score * each.agrees)
        alike = [
            each.place
            for each in likely
            if each.score >= _ALIKE * best.score
            and each.agrees >= _ALIKE * best.agrees
            and not self._is_same(best, each)
        ]
        if alike:
            self.reason = f"from here {' and '.join([best.place, *alike])} look alike"
            return
        self.found = best

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


def _score(sighting: Sighting | None) -> float:
    return 0.0 if sighting is None else sighting.score


def appearances(topology: TopologicalMap) -> dict[str, Appearance]:
    """Return what all places look like, by name, with all code compiled that compares."""
    result = {place.name: Appearance(place) for place in topology.places}
    for place in topology.places[:1]:
        look = look_of(_scan((0.0, 0.0), place.depth_m))
        if look is not None:
            result[place.name].follow(look, SE2(), 0.0)
    return result
