"""Local map: the surfaces of a few keyframes in one frame, with which scans are matched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Correlation, Window, search
from robotctl.estimation.slam.front_end.point_to_line import Bins, Match, binned, refine
from robotctl.estimation.slam.front_end.score_field import ScoreField, score_field
from robotctl.estimation.slam.front_end.surface import Floats, Surface
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """Surfaces in one frame, sorted for the refinement and blurred for the search.

    It is no `OccupancyGrid`: scans are matched with points and normals to a fraction of a cell, and
    it lives only as long as its few keyframes; nobody plans on it or sees it.
    """

    bins: Bins
    field: ScoreField

    def fit(
        self,
        surface: Surface,
        points: Floats,
        window: Window,
        least: float,
        prior_information: Floats | None = None,
    ) -> Fit | None:
        """Return where a scan fits best: searched for in a window, then refined.

        Parameters
        ----------
        surface, points
            The scan, and those of its points that the search compares.
        window, least
            Where to search, and the score that a pose must exceed.
        prior_information
            Information (3, 3) by which the refinement is held near the pose of the search.
        """
        found = search(self.field, points, window, least)
        if found is None:
            return None
        match = refine(self.bins, surface, found.pose, found.pose, prior_information)
        return Fit(found.pose, found.score, match)

    def rival(self, points: Floats, window: Window, share: float, fit: Fit) -> Correlation | None:
        """Return another place in a window that has more than a share of a fit's score."""
        return search(self.field, points, window, share * fit.score, fit.pose)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A scan on a local map.

    Parameters
    ----------
    pose, score
        Pose of `base` by the search, and its score, 0 to 1.
    match
        Refinement of it.
    """

    pose: SE2
    score: float
    match: Match


def map_of(surface: Surface) -> LocalMap:
    """Return the map of a surface."""
    return LocalMap(binned(surface), score_field(surface.outline))


def thinned(points: Floats, most: int) -> Floats:
    """Return at most so many of points (n, 2), evenly chosen."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).astype(np.int64)]
