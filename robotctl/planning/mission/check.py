"""Whether a robot can drive a mission."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robotctl.errors import MissionError
from robotctl.model.drives.drives import Drive
from robotctl.planning.behaviours.mission import (
    DriveItem,
    FollowWallItem,
    Item,
    Mission,
    TurnToItem,
)
from robotctl.planning.guard.obstacle_guard import GuardConfig
from robotctl.planning.local.path import Path


def item_title(mission: Mission, index: int) -> str:
    """Return how messages call an item: `item 2 "south wall" (follow_wall)`, counted from 1."""
    item = mission.item[index]
    name = f' "{item.name}"' if item.name else ""
    return f"item {index + 1}{name} ({item.kind})"


def check_mission(
    mission: Mission, drive: Drive, sides: frozenset[str], guard: GuardConfig
) -> None:
    """Check that a robot can drive a mission.

    Parameters
    ----------
    mission
        The mission.
    drive
        Its drive model.
    sides
        Directions in which it has a sonar: any of "left", "right", "front".
    guard
        Of the obstacle guard: nothing ahead comes nearer than its margin, and no wall beside than
        half of the robot's width.

    Raises
    ------
    MissionError
        With one line for each item that it cannot drive.
    """
    problems = [
        f"{mission.name}: {item_title(mission, index)}: {problem}"
        for index, item in enumerate(mission.item)
        for problem in _problems(item, drive, sides, guard)
    ]
    if problems:
        raise MissionError("\n".join(problems))


def _problems(item: Item, drive: Drive, sides: frozenset[str], guard: GuardConfig) -> Iterator[str]:
    """Yield why a robot cannot do an item."""
    if isinstance(item, TurnToItem) and drive.steered:
        yield f"a robot with {drive.kind} drive cannot turn on the spot; use drive with an arc"
    if isinstance(item, DriveItem) and drive.steered:
        radius = drive.min_turning_radius_m
        if item.corner_radius_m < radius and _has_corner(item):
            yield (
                f"corner_radius_m = {item.corner_radius_m:g} is below the turning radius of this "
                f"robot, {radius:.3f} m"
            )
    if isinstance(item, FollowWallItem):
        needed = [item.side] + (["front"] if item.until.front_below_m is not None else [])
        for side in needed:
            if side not in sides:
                yield f"this robot has no sonar that looks to the {side}"
        if item.distance_m < guard.half_width_m:
            yield (
                f"distance_m = {item.distance_m:g} is from the robot's middle to the wall, which "
                f"half of its width would touch; {guard.half_width_m:g} at least "
                "(navigation.guard.half_width_m) is allowed"
            )
        front_m = item.until.front_below_m
        if front_m is not None and front_m <= guard.margin_m:
            yield (
                f"until.front_below_m = {front_m:g} is never reached, since this robot stops "
                f"{guard.margin_m:g} m "
                "before an obstacle; above navigation.guard.margin_m is allowed"
            )


def _has_corner(item: DriveItem) -> bool:
    """Say whether the way between the waypoints turns by more than 10 degrees anywhere."""
    way = Path(item.waypoints)
    turns = (way.turn_rad(i) for i in range(1, len(way.points) - 1))
    return any(abs(turn) > math.radians(10.0) for turn in turns)
