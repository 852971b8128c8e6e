"""A kind of behaviour: how one is made, how long it may take, which robots cannot do it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from robotctl.model.drives.drives import Drive
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.guard.behaviour import Behaviour
from robotctl.planning.guard.obstacle_guard import GuardConfig, ObstacleGuard
from robotctl.planning.local.path import Point

if TYPE_CHECKING:
    from robotctl.planning.config import NavigationConfig  # which has settings of behaviours


class Paths(Protocol):
    """Knows free paths through the world, as `FreePaths` of a map does."""

    def way(self, start: Point, goal: Point) -> list[Point]:
        """Return the corners after `start`, `goal` the last; none if there is no path."""


@dataclass(slots=True)
class NavigatedRobot:
    """The robot as behaviours see it.

    Parameters
    ----------
    config
        Settings of the navigator.
    drive, mounts
        Kinematics, and the sonars in the order of the ranges.
    guard
        Shared by all behaviours; the navigator feeds it.
    crumbs
        The path from home.
    paths
        Free paths through the world; None: paths are straight lines.
    """

    config: NavigationConfig
    drive: Drive
    mounts: Sequence[SonarMount]
    guard: ObstacleGuard
    crumbs: Breadcrumbs
    paths: Paths | None = None


def _never(_wanted: object) -> float | None:
    return None


def _nothing(*_arguments: object) -> Iterator[str]:
    return iter(())


class Kind(NamedTuple):
    """An entry of `BEHAVIOURS`."""

    make: Callable[[Any, NavigatedRobot], Behaviour]
    """Returns the behaviour for an item, a request or a mode."""
    time_out_s: Callable[[Any], float | None] = _never
    """Returns after which time it fails [s]; None: never."""
    problems: Callable[[Any, Drive, frozenset[str], GuardConfig], Iterator[str]] = _nothing
    """Yields why a robot with this drive and sonars to these sides cannot do it."""
