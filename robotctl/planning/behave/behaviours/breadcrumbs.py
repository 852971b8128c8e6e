"""The path home: where the robot has been, without loops."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import NamedTuple

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.local.path import Point

_SAME_HEADING_RAD = math.radians(20.0)
_RECENT = 5
_JOINED_M = 1.0
"""A jump larger than this leaves a gap in the known path [m]."""


class Crumb(NamedTuple):
    """One place on the path."""

    x_m: float
    y_m: float
    theta_rad: float
    reverse: bool
    """Whether the robot came here from the previous crumb in reverse gear."""
    gap: bool = False
    """Whether the path from the previous crumb is unknown."""


class Leg(NamedTuple):
    """A part of the path home driven in one gear."""

    points: tuple[Point, ...]
    """At least two, from the robot towards home."""
    reverse: bool
    last: int
    """Index of the crumb at `points[0]`; the next point is the crumb before it."""


class Breadcrumbs:
    """Remembers the path from home as points `spacing_m` apart.

    When the robot returns to a place, the loop in between is forgotten. A drive-and-steer robot
    returns in reverse gear along its own tracks, since it cannot turn on the spot and may not have
    room for a U-turn; there a place counts as the same only with the same heading and gear. Beyond
    `count_max` crumbs every second one is dropped.

    If a pose is far from the previous one (the localiser has found the robot elsewhere, or this
    process began in the middle of a run), there is a gap: the straight line between them may lead
    through walls. It disappears when the robot reaches a place from before the gap.

    Parameters
    ----------
    home
        The first crumb.
    steered
        The robot is of the drive-and-steer kind.
    spacing_m
        Distance of the crumbs [m], > 0.
    count_max
        Maximum number of crumbs.
    """

    def __init__(
        self, home: SE2, *, steered: bool, spacing_m: float = 0.1, count_max: int = 20_000
    ) -> None:
        self._steered = steered
        self._spacing = spacing_m
        self._count_max = count_max
        self.begin(home)

    def begin(self, home: SE2) -> None:
        """Forget the path; it begins at another home."""
        self._crumbs = [Crumb(home.x_m, home.y_m, home.theta_rad, False)]
        self._cells: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        self._enter(0)

    def __len__(self) -> int:
        """Return the number of crumbs."""
        return len(self._crumbs)

    @property
    def home(self) -> SE2:
        """Start of the path."""
        home = self._crumbs[0]
        return SE2(home.x_m, home.y_m, home.theta_rad)

    @property
    def has_gap(self) -> bool:
        """Whether a part of the path home is unknown."""
        return any(crumb.gap for crumb in self._crumbs)

    def record(self, pose: SE2) -> None:
        """Record that the robot is at `pose`."""
        last = self._crumbs[-1]
        dx, dy = pose.x_m - last.x_m, pose.y_m - last.y_m
        if dx * dx + dy * dy < self._spacing * self._spacing:
            return
        # By the motion, not the command: whoever drove, the robot can return by the same tracks.
        backwards = dx * math.cos(pose.theta_rad) + dy * math.sin(pose.theta_rad) < 0.0
        gap = math.hypot(dx, dy) > max(_JOINED_M, 2.0 * self._spacing)
        crumb = Crumb(pose.x_m, pose.y_m, pose.theta_rad, backwards, gap)
        seen = self._same_place(crumb)
        if seen is not None:
            self.truncate(seen + 1)
            return
        self._crumbs.append(crumb)
        self._enter(len(self._crumbs) - 1)
        if len(self._crumbs) > self._count_max:
            self._thin()

    def nearest(self, pose: SE2) -> Crumb:
        """Forget the path beyond the crumb nearest to a pose, and return that crumb."""
        distances = [math.hypot(each.x_m - pose.x_m, each.y_m - pose.y_m) for each in self._crumbs]
        self.truncate(distances.index(min(distances)) + 1)
        return self._crumbs[-1]

    def truncate(self, count: int) -> None:
        """Keep the first `count` crumbs, at least home."""
        count = max(count, 1)
        for index in range(count, len(self._crumbs)):
            self._cells[self._cell(self._crumbs[index])].remove(index)
        del self._crumbs[count:]

    def legs(self) -> list[Leg]:
        """Return the path home, one leg per gear; none when the robot is home.

        A differential drive always drives forwards: it turns round on the spot.
        """
        legs: list[Leg] = []
        end = len(self._crumbs) - 1
        while end > 0:
            start = end - 1
            gear = self._crumbs[end].reverse
            while start > 0 and (not self._steered or self._crumbs[start].reverse == gear):
                start -= 1
            points = tuple((c.x_m, c.y_m) for c in reversed(self._crumbs[start : end + 1]))
            legs.append(Leg(points, self._steered and not gear, end))
            end = start
        return legs

    def _same_place(self, crumb: Crumb) -> int | None:
        """Return the earliest crumb at the place of `crumb`, except the latest few."""
        cx, cy = self._cell(crumb)
        # The latest crumbs are near because the robot has just left them, not because it returned.
        latest = len(self._crumbs) - (0 if crumb.gap else _RECENT)
        near = [
            index
            for x in (cx - 1, cx, cx + 1)
            for y in (cy - 1, cy, cy + 1)
            for index in self._cells.get((x, y), ())
            if index < latest and self._same(self._crumbs[index], crumb)
        ]
        return min(near, default=None)

    def _same(self, a: Crumb, b: Crumb) -> bool:
        if math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) > self._spacing:
            return False
        if not self._steered:
            return True
        turned = abs(wrap_angle(a.theta_rad - b.theta_rad))
        return a.reverse == b.reverse and turned < _SAME_HEADING_RAD

    def _thin(self) -> None:
        """Drop every second crumb and double the spacing."""
        # A gap before a dropped crumb moves to the next one: it must not be forgotten.
        gaps = [False, *(crumb.gap for crumb in self._crumbs)]  # of the one before each
        self._crumbs = [
            crumb._replace(gap=crumb.gap or gaps[index])
            for index, crumb in enumerate(self._crumbs)
            if index % 2 == 0
        ]
        self._spacing *= 2.0
        self._cells.clear()
        for index in range(len(self._crumbs)):
            self._enter(index)

    def _enter(self, index: int) -> None:
        self._cells[self._cell(self._crumbs[index])].append(index)

    def _cell(self, crumb: Crumb) -> tuple[int, int]:
        return math.floor(crumb.x_m / self._spacing), math.floor(crumb.y_m / self._spacing)
