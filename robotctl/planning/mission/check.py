"""Whether a robot can drive a mission."""

from __future__ import annotations

from robotctl.errors import MissionError
from robotctl.model.drives.drives import Drive
from robotctl.planning.behaviours.mission import Mission
from robotctl.planning.behaviours.registry import BEHAVIOURS
from robotctl.planning.guard.obstacle_guard import GuardConfig


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
        for problem in BEHAVIOURS[type(item)].problems(item, drive, sides, guard)
    ]
    if problems:
        raise MissionError("\n".join(problems))
