"""A path as a local controller follows it: points a step apart, cut where the gear changes."""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

_SPACING_M: Final = 0.05
"""Approximate spacing of the points [m]."""
_SHORTEST_M: Final = 1e-3
"""A piece of a path that is shorter is a turn on the spot."""
_BENT_RAD: Final = 0.5
"""A piece whose ends look no farther from its chord is an arc."""
_BACK_M: Final = 0.5
_ON_M: Final = 1.0
"""How far back and on the robot is looked for along the path."""


class Section(NamedTuple):
    """A piece of a path that is driven in one gear."""

    points: NDArray[np.float64]
    """(n, 3): x, y and the direction in which the robot is to look there [m, m, rad]; without
    jumps of 2 pi."""
    bends_per_m: NDArray[np.float64]
    """(n,) change of that direction per length of the path [rad/m]."""
    spacing_m: float
    """Spacing of the points along the path [m]."""
    reverse: bool


class Reference(NamedTuple):
    """Nominal place of the robot, as seen from the path."""

    beside_m: float
    """How far the robot is to the left of the path, as it is to look there [m]."""
    turned_rad: float
    """Heading to the left of that direction [rad]."""
    bend_per_m: float
    """Change of that direction per length of the path [rad/m]."""
    way_m: float
    """Length to the section's end [m]; negative behind it."""


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

    def reference(self, pose: SE2) -> Reference:
        """Return where a robot is beside the path."""
        points, spacing_m = self.section.points, self.section.spacing_m
        x_m, y_m, angle = points[self._index].tolist()
        bend = float(self.section.bends_per_m[self._index])
        here = SE2(x_m, y_m, angle).inverse() @ pose
        on_m = -here.x_m if self.section.reverse else here.x_m
        return Reference(
            here.y_m - 0.5 * bend * on_m * abs(on_m),
            wrap_angle(here.theta_rad - bend * on_m),
            bend,
            (len(points) - 1 - self._index) * spacing_m - on_m,
        )

    def jumps(self, length_m: float) -> NDArray[np.float64]:
        """Return where the bend changes about here and over a length, (n, 2): way, change."""
        spacing_m = self.section.spacing_m
        first = max(self._index - 1, 0)
        end = self._index + math.ceil(length_m / spacing_m)
        changes = np.abs(np.diff(self.section.bends_per_m[first : end + 1]))
        ways = (np.arange(len(changes)) + first - self._index) * spacing_m
        return np.stack([np.maximum(ways, 0.0), changes], axis=1)

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
        return [Section(np.repeat(path[-1:], 2, axis=0), np.zeros(2), _SHORTEST_M, False)]
    gears = reverse[kept]
    cuts = np.flatnonzero(gears[1:] != gears[:-1]) + 1
    finals = path[kept + 1, 2]
    bounds = [0, *cuts.tolist(), len(kept)]
    return [
        _section(path[kept[a:b]], steps[kept[a:b]], lengths[kept[a:b]], finals[a:b], bool(gears[a]))
        for a, b in itertools.pairwise(bounds)
    ]


def _section(
    starts: NDArray[np.float64],
    steps: NDArray[np.float64],
    lengths: NDArray[np.float64],
    finals: NDArray[np.float64],
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
    points[:, 2] = np.unwrap(_headings(starts, steps, finals, reverse, piece, share))
    spacing_m = float(ends[-1]) / count
    return Section(points, np.gradient(points[:, 2], spacing_m), spacing_m, reverse)


def _headings(
    starts: NDArray[np.float64],
    steps: NDArray[np.float64],
    finals: NDArray[np.float64],
    reverse: bool,
    piece: NDArray[np.int64],
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the heading at a share of each piece: on an arc it changes from end to end."""
    chord = np.arctan2(steps[:, 1], steps[:, 0]) + (math.pi if reverse else 0.0)
    before, after = (
        np.arctan2(np.sin(each - chord), np.cos(each - chord)) for each in (starts[:, 2], finals)
    )
    is_arc = np.maximum(np.abs(before), np.abs(after)) < _BENT_RAD
    turned = np.where(is_arc[piece], before[piece] + share * (after - before)[piece], 0.0)
    headings: NDArray[np.float64] = chord[piece] + turned
    return headings
