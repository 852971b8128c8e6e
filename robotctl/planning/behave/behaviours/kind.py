"""A kind of behaviour: how one is made, how long it may take, which robots cannot do it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from robotctl.model.drives.drives import Drive
from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import Behaviour
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.config import GuardConfig, NavigationConfig, RecoveryConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.guard.sonars import sonar_directions
from robotctl.planning.map.seen import Seen
from robotctl.planning.map.zone import Zone
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.local.path import Point

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robotctl.model.grid_map import GridMap  # which loads numpy
    from robotctl.planning.behave.behaviours.outlook import Outlook  # which loads numpy


class Pace(Protocol):
    """The time that steps take, and what they may do in it."""

    @property
    def effort(self) -> float:
        """Share of its samples by which it steers, in (0, 1]: fewer where steps take too long."""

    def lap(self, part: str) -> None:
        """Note that a part of the step is over."""


class Unhurried:
    """The pace of steps whose time does not count."""

    effort = 1.0

    def lap(self, part: str) -> None:
        """Take no notice."""


UNHURRIED: Final = Unhurried()


class Pilot(Protocol):
    """Knows what stands around the robot, and finds ways through it."""

    @property
    def plans(self) -> int:
        """Paths taken since the start."""

    @property
    def recoveries(self) -> int:
        """Tries to get on again since the start."""

    @property
    def knows_ways(self) -> bool:
        """Whether it has a map, or a lidar that shows the way; else only sonars."""

    @property
    def may_move(self) -> tuple[bool, ...]:
        """Whether the last two echoes of each sonar are of something that was not there before."""

    @property
    def moving(self) -> NDArray[np.float64]:
        """Things that a lidar sees move, (k, 5), as `LocalSituation.moving`."""

    @property
    def areas(self) -> tuple[str, ...]:
        """Names of the areas of binary masks that `base` is in."""

    def see(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take in what was seen; `pose` is that of `base` in `world` now."""

    def use_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones of another mission, which count beside those of the robot's file."""

    def use_drawn_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones that people have drawn, which count beside all others."""

    def use_recovery(self, recovery: RecoveryConfig | None) -> None:
        """Be as patient as a mission says; None: as the robot's file does."""

    def use_fence(self, fence: Fence) -> None:
        """Plan within another fence."""

    def use_body(self, footprint: Footprint) -> None:
        """Plan and drive with another body from now on."""

    def forget(self) -> None:
        """Forget what was seen: the robot's pose in `world` has jumped."""

    def recall(self, grid: GridMap) -> None:
        """Know what a map knows that the robot has made, in place of what was seen so far."""

    def use_reverse(self, *, reverse: bool) -> None:
        """Drive journeys in reverse from now on, or ahead again."""

    def journey(self, goal: Goal, speed_m_s: float) -> Behaviour:
        """Return the behaviour that drives to a goal."""

    def exploration(self, speed_m_s: float) -> Behaviour:
        """Return the behaviour that drives to what is unknown."""

    def travel(self, place: str, start: str, speed_m_s: float) -> Behaviour:
        """Return the behaviour that drives to a place by recognising places; "": any start."""

    def outlook(self) -> Outlook:
        """Return what it drives by and sees now, for people."""


class Abilities(NamedTuple):
    """Abilities that mission items require of a robot."""

    drive: Drive
    sides: frozenset[str]
    """Directions in which it has a sonar, as `sonar_directions` names them."""
    guard: GuardConfig
    """Nothing ahead comes nearer than the margin of this."""
    body: Footprint
    """No wall beside comes nearer than the sides of this."""
    sees_markers: bool = False
    """Whether a camera of it looks for markers."""
    places: tuple[str, ...] = ()
    """Names of the places that it can drive to."""


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
    sees_markers
        Whether a camera of it looks for markers.
    places
        Names of the places that it can drive to.
    pilot
        Plans; None: the robot has nothing to plan by.
    rally
        Places of `world` that it may return to in place of home [m].
    reverse
        Whether it drives to places in reverse.
    """

    config: NavigationConfig
    drive: Drive
    mounts: Sequence[SonarMount]
    guard: ObstacleGuard
    crumbs: Breadcrumbs
    sees_markers: bool = False
    places: tuple[str, ...] = ()
    pilot: Pilot | None = None
    rally: tuple[Point, ...] = ()
    reverse: bool = False

    @property
    def abilities(self) -> Abilities:
        """Abilities that mission items ask about."""
        sides = sonar_directions(self.mounts)
        guard = self.config.guard
        body = self.guard.body
        return Abilities(self.drive, sides, guard, body, self.sees_markers, self.places)

    @property
    def against_reverse(self) -> str:
        """Why it cannot drive to places in reverse; empty if it can."""
        if self.pilot is not None and self.drive.steered:
            return "a robot that steers by plan chooses its gear itself"
        if self.pilot is None and not self.guard.looks(-1.0):
            return "no sonar looks back"
        return ""

    @property
    def plans_home(self) -> bool:
        """Whether it knows enough of the world to plan the way home."""
        return self.pilot is not None and self.pilot.knows_ways


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
    problems: Callable[[Any, Abilities], Iterator[str]] = _nothing
    """Yields why a robot with such abilities cannot do it."""
    piloted: bool = False
    """Whether it needs the robot's pilot."""
    drives: bool = True
    """Whether the robot moves."""


def out_of_reach(distance_m: float, guard: GuardConfig) -> Iterator[str]:
    """Yield why a robot never comes as near to what is ahead as `distance_m` [m], if so."""
    if distance_m <= guard.margin_m:
        yield (
            f"distance_m = {distance_m:g} is never reached, since this robot stops "
            f"{guard.margin_m:g} m before an obstacle; above navigation.guard.margin_m is allowed"
        )
