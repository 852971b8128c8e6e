"""Mission files: what the robot shall do, step by step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from robotctl import toml_source
from robotctl.errors import InvalidValue
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.local.path import Path, Point, rounded

Side: TypeAlias = Literal["left", "right"]

LARGEST: Final = 1e6
"""No number of a mission is larger, whether metres, seconds, metres per second or degrees."""


@dataclass(frozen=True, slots=True)
class StartPose:
    """Where the robot stands at the start, in `world`."""

    x_m: float
    y_m: float
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        _require_bounded(self, "x_m", "y_m", "heading_deg")

    @property
    def pose(self) -> SE2:
        """The pose `T_world_base`."""
        return SE2(self.x_m, self.y_m, math.radians(self.heading_deg))


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
        What people call it.
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
        _require_positive(self, "speed_m_s", "time_out_s")
        if not 0.0 <= self.corner_radius_m <= LARGEST:
            raise InvalidValue(
                "corner_radius_m",
                f"must be 0 to {LARGEST:.0f}, not {self.corner_radius_m}",
                self.corner_radius_m,
            )
        _require_points("waypoints", self.waypoints)
        self.path()

    def path(self) -> Path:
        """Return the path with its corners rounded."""
        return Path(rounded(self.waypoints, self.corner_radius_m))


@dataclass(frozen=True, slots=True)
class Until:
    """When wall following is done: as soon as one of the conditions given is met.

    Parameters
    ----------
    length_m
        The robot has travelled this far [m], > 0.
    front_below_m
        The front sonar sees something nearer than this [m], > 0.
    position
        The robot has come abeam of this point of `world` [m], or past it.
    """

    length_m: float | None = None
    front_below_m: float | None = None
    position: Point | None = None

    def __post_init__(self) -> None:
        _require_positive(self, "length_m", "front_below_m")
        if (self.length_m, self.front_below_m, self.position) == (None, None, None):
            raise ValueError("one of length_m, front_below_m and position is needed")
        if self.position is not None:
            _require_points("position", (self.position,))


@dataclass(frozen=True, slots=True)
class FollowWallItem:
    """Drive along a wall at a constant distance.

    Parameters
    ----------
    kind
        Always "follow_wall".
    side
        Where the wall is: "left" or "right".
    distance_m
        Wanted distance of `base`, the middle of the robot, from the wall [m], > 0: what the sonar
        on that side reads, and how far aside it sits.
    until
        When it is done.
    speed_m_s
        Speed [m/s], > 0.
    name
        What people call it.
    time_out_s
        The item fails after this time [s], > 0. Default: from its length and speed, or 60 s.
    """

    kind: Literal["follow_wall"]
    side: Side
    distance_m: float
    until: Until
    speed_m_s: float = 0.3
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        _require_positive(self, "distance_m", "speed_m_s", "time_out_s")


@dataclass(frozen=True, slots=True)
class GoToItem:
    """Drive to a point of `world` on the direct way, with any heading at its end.

    Parameters
    ----------
    kind
        Always "go_to".
    x_m, y_m
        The point [m].
    speed_m_s
        Largest speed [m/s], > 0.
    name
        What people call it.
    time_out_s
        The item fails after this time [s], > 0.
    """

    kind: Literal["go_to"]
    x_m: float
    y_m: float
    speed_m_s: float = 0.4
    name: str = ""
    time_out_s: float | None = 60.0

    def __post_init__(self) -> None:
        _require_bounded(self, "x_m", "y_m")
        _require_positive(self, "speed_m_s", "time_out_s")


@dataclass(frozen=True, slots=True)
class TurnToItem:
    """Turn on the spot to a heading. Not for drive-and-steer robots.

    Parameters
    ----------
    kind
        Always "turn_to".
    heading_deg
        Heading in `world`, 0 along x, 90 along y [deg].
    name
        What people call it.
    time_out_s
        The item fails after this time [s], > 0.
    """

    kind: Literal["turn_to"]
    heading_deg: float
    name: str = ""
    time_out_s: float | None = 20.0

    def __post_init__(self) -> None:
        _require_bounded(self, "heading_deg")
        _require_positive(self, "time_out_s")


@dataclass(frozen=True, slots=True)
class WaitItem:
    """Stand still.

    Parameters
    ----------
    kind
        Always "wait".
    duration_s
        How long [s], > 0.
    name
        What people call it.
    """

    kind: Literal["wait"]
    duration_s: float
    name: str = ""

    def __post_init__(self) -> None:
        _require_positive(self, "duration_s")


Item: TypeAlias = DriveItem | FollowWallItem | GoToItem | TurnToItem | WaitItem


@dataclass(frozen=True, slots=True)
class Mission:
    """What a mission file says.

    Parameters
    ----------
    name
        What people call it.
    world
        Name of the world's file in `configs/worlds` that it is made for.
    start
        Where the robot stands at the beginning.
    item
        The steps, at least one, written as `[[item]]`.
    """

    name: str
    world: str
    start: StartPose
    item: tuple[Annotated[Item, Field(discriminator="kind")], ...]

    def __post_init__(self) -> None:
        if not self.item:
            raise ValueError("a mission needs at least one [[item]]")


def parse_mission(text: str, file_name: str) -> Mission:
    """Return the mission in the TOML `text` of `file_name`.

    Raises
    ------
    ConfigError
        With one line for each error: file, line, key, what is wrong, nearest right name.
    """
    return toml_source.parse(text, Mission, file_name)


def _require_bounded(item: object, *keys: str) -> None:
    for key in keys:
        value = getattr(item, key)
        if not abs(value) <= LARGEST:
            raise InvalidValue(key, f"must be -{LARGEST:.0f} to {LARGEST:.0f}, not {value}", value)


def _require_positive(item: object, *keys: str) -> None:
    for key in keys:
        value = getattr(item, key)
        if value is not None and not 0.0 < value <= LARGEST:
            raise InvalidValue(
                key, f"must be above 0 and at most {LARGEST:.0f}, not {value}", value
            )


def _require_points(key: str, points: Sequence[Point]) -> None:
    for point in points:
        if not all(abs(value) <= LARGEST for value in point):
            raise InvalidValue(
                key, f"must have coordinates of -{LARGEST:.0f} to {LARGEST:.0f}, not {point}", point
            )
