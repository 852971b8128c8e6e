"""A path as a local controller follows it: points a step apart, cut where the gear changes."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2

_SPACING_M: Final = 0.05
"""Between two points, about."""
_SHORTEST_M: Final = 1e-3
"""A piece of a path that is shorter is a turn on the spot."""
_BACK_M: Final = 0.5
_ON_M: Final = 1.0
"""How far back and on the robot is looked for along the path."""


class Section(NamedTuple):
    """A piece of a path that is driven in one gear."""

    points: NDArray[np.float64]
    """(n, 3): x, y and the direction in which the robot is to look there [m, m, rad]."""
    spacing_m: float
    """Between two points along the path [m]."""
    reverse: bool


class Track:
    """A path and how far along it the robot is.

    Parameters
    ----------
    path, reverse
        As in `LocalSituation`.
    """

    def __init__(self, path: NDArray[np.float64], reverse: NDArray[np.bool_]) -> None:
        self._sections = _sections(path, reverse)
        self._number = 0
        self._index = 0
        self.goal = SE2(*path[-1].tolist())

    @property
    def section(self) -> Section:
        """The piece on which the robot is."""
        return self._sections[self._number]

    @property
    def is_last(self) -> bool:
        """Whether the goal is at the end of this section."""
        return self._number == len(self._sections) - 1

    @property
    def remaining_m(self) -> float:
        """Length from the point nearest to the robot to the section's end [m]."""
        return (len(self.section.points) - 1 - self._index) * self.section.spacing_m

    def advance(self, pose: SE2) -> None:
        """Look for the robot a little ahead and behind of where it was."""
        points, spacing_m = self.section.points, self.section.spacing_m
        first = max(0, self._index - math.ceil(_BACK_M / spacing_m))
        near = points[first : self._index + math.ceil(_ON_M / spacing_m) + 1]
        squared = (near[:, 0] - pose.x_m) ** 2 + (near[:, 1] - pose.y_m) ** 2
        self._index = first + int(np.argmin(squared))

    def next_section(self) -> None:
        """Go on to the next piece, in the other gear."""
        self._number += 1
        self._index = 0

    def window(self, length_m: float) -> tuple[NDArray[np.float64], bool]:
        """Return the points from the robot on over a length, and whether the section ends there."""
        points = self.section.points
        end = self._index + math.ceil(length_m / self.section.spacing_m) + 1
        first = min(self._index, len(points) - 2)
        return points[first:end], end >= len(points)


def _sections(path: NDArray[np.float64], reverse: NDArray[np.bool_]) -> list[Section]:
    """Cut a path where the gear changes; turns on the spot are left out."""
    steps = np.diff(path[:, :2], axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    kept = np.flatnonzero(lengths > _SHORTEST_M)
    if not len(kept):
        return [Section(np.repeat(path[-1:], 2, axis=0), _SHORTEST_M, False)]
    gears = reverse[kept]
    cuts = np.flatnonzero(gears[1:] != gears[:-1]) + 1
    return [
        _section(path[pieces], steps[pieces], lengths[pieces], bool(reverse[pieces[0]]))
        for pieces in np.split(kept, cuts)
    ]


def _section(
    starts: NDArray[np.float64],
    steps: NDArray[np.float64],
    lengths: NDArray[np.float64],
    reverse: bool,
) -> Section:
    """Return evenly spaced points along pieces that follow each other."""
    ends = np.cumsum(lengths)
    count = max(1, round(ends[-1] / _SPACING_M))
    along = np.linspace(0.0, ends[-1], count + 1)
    piece = np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1)
    share = (along - (ends[piece] - lengths[piece])) / lengths[piece]
    points = starts[piece].copy()
    points[:, :2] += share[:, np.newaxis] * steps[piece]
    points[:, 2] = np.arctan2(steps[piece, 1], steps[piece, 0]) + (math.pi if reverse else 0.0)
    return Section(points, float(ends[-1]) / count, reverse)
