"""The behaviour that drives along a path."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.item import (
    LARGEST,
    require_points,
    require_positive,
    time_for,
)
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot
from robotctl.planning.behave.behaviours.rearwards import Rearwards
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.path import Path, Point, rounded
from robotctl.planning.path.local.pursuit import Pursuit

_TURN_IN_CIRCLES = 1.5
"""A robot that joins its path is aligned with it after this many turning circles of travel."""


@dataclass(frozen=True, slots=True)
class DriveItem:
    """Drive along a path. The robot must stand near its beginning.

    Parameters
    ----------
    kind
        Always "drive".
    waypoints
        At least two points of `world` [m]; the last one is the goal.
    corner_radius_m
        Radius of the arcs that round the corners [m], >= 0. A drive-and-steer robot needs at
        least its turning radius.
    speed_m_s
        Largest speed [m/s], > 0.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0. Default: from its length and speed.
    """

    kind: Literal["drive"]
    waypoints: tuple[Point, ...]
    corner_radius_m: float = 0.0
    speed_m_s: float = 0.4
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "speed_m_s", "time_out_s")
        if not 0.0 <= self.corner_radius_m <= LARGEST:
            raise InvalidValue(
                "corner_radius_m",
                f"must be 0 to {LARGEST:.0f}, not {self.corner_radius_m}",
                self.corner_radius_m,
            )
        require_points("waypoints", self.waypoints)
        self.path()

    def path(self) -> Path:
        """Return the path with its corners rounded."""
        return Path(rounded(self.waypoints, self.corner_radius_m))


class FollowPath(Behaviour):
    """Drives along a path from near its beginning to its end.

    After an interruption it continues from where it was; `reset` begins at the start again.

    Parameters
    ----------
    path
        The path, in `world`.
    config, drive, speed_m_s, reverse
        As for `Pursuit`.
    """

    def __init__(
        self,
        path: Path,
        config: PursuitConfig,
        drive: Drive,
        speed_m_s: float,
        *,
        reverse: bool = False,
    ) -> None:
        self._path = path
        self._pursuit = Pursuit(path, config, drive, speed_m_s, reverse=reverse)
        self._off_path_max = config.off_path_max_m
        self._circle_m = 2.0 * drive.min_turning_radius_m
        self._joined_s_m = -math.inf

    def anchor(self, pose: SE2) -> Anchor:  # noqa: ARG002 - as all behaviours
        """Return where on the path the robot is, or was left."""
        return Anchor(*self._path.point_at(self._pursuit.s_m))

    def join(self) -> None:
        """Continue from where it stopped with any heading, which may take a turning circle."""
        self._joined_s_m = self._pursuit.s_m

    @property
    def s_m(self) -> float:
        """Length along the path up to where the robot is [m]."""
        return self._pursuit.s_m

    def resume(self, s_m: float) -> None:
        """Continue with a robot near the length `s_m` along the path [m], where it once was."""
        self._pursuit.reset(s_m)

    def reset(self) -> None:
        """Begin at the start of the path."""
        self._pursuit.reset()
        self._joined_s_m = -math.inf

    def pause(self) -> None:
        """Keep the progress along the path."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next velocity; fails further off the path than allowed."""
        step = self._pursuit.step(situation.pose, situation.twist)
        joining = self._pursuit.s_m - self._joined_s_m <= _TURN_IN_CIRCLES * self._circle_m
        # A robot that turns back onto its path needs its turning circle beside it.
        most_m = self._off_path_max + (self._circle_m if joining else 0.0)
        if step.off_path_m > most_m:
            return failed(f"{step.off_path_m:.2f} m off the path, {most_m:g} m are allowed")
        if step.done:
            return done()
        return BehaviourOutput(step.v_m_s, step.omega_rad_s, text=f"{step.remaining_m:.1f} m to go")


def _make(item: DriveItem, robot: NavigatedRobot) -> Behaviour:
    ahead = FollowPath(item.path(), robot.config.pursuit, robot.drive, item.speed_m_s)
    return Rearwards(ahead, robot)


def _time_out_s(item: DriveItem) -> float:
    return item.time_out_s or time_for(item.path().length_m, item.speed_m_s)


def _problems(item: DriveItem, robot: Abilities) -> Iterator[str]:
    radius = robot.drive.min_turning_radius_m
    if robot.drive.steered and item.corner_radius_m < radius and _has_corner(item):
        yield (
            f"corner_radius_m = {item.corner_radius_m:g} is below the turning radius of this "
            f"robot, {radius:.3f} m"
        )


def _has_corner(item: DriveItem) -> bool:
    """Return whether the path between the waypoints turns by more than 10 degrees anywhere."""
    way = Path(item.waypoints)
    turns = (way.turn_rad(i) for i in range(1, len(way.points) - 1))
    return any(abs(turn) > math.radians(10.0) for turn in turns)


DRIVE = Kind(_make, _time_out_s, _problems)
