"""Whether a robot can drive a mission."""

from __future__ import annotations

from collections.abc import Iterator

from robotctl.errors import MissionError
from robotctl.planning.behave.behaviours.kind import Abilities
from robotctl.planning.behave.behaviours.registry import kind_of
from robotctl.planning.behave.mission.flow import flow_problems
from robotctl.planning.behave.mission.mission_file import Mission


def item_title(mission: Mission, index: int) -> str:
    """Return how messages call an item: `item 2 "south wall" (follow_wall)`, counted from 1."""
    item = mission.item[index]
    name = f' "{item.name}"' if item.name else ""
    return f"item {index + 1}{name} ({item.kind})"


def check_mission(mission: Mission, robot: Abilities) -> None:
    """Check that a robot can drive a mission.

    Parameters
    ----------
    mission
        The mission.
    robot
        What the robot can do.

    Raises
    ------
    MissionError
        With one line for each item that it cannot drive.
    """
    problems = [
        f"{mission.name}: {item_title(mission, index)}: {problem}"
        for index, problem in _problems(mission, robot)
    ]
    if problems:
        raise MissionError("\n".join(problems))


def _problems(mission: Mission, robot: Abilities) -> Iterator[tuple[int, str]]:
    """Yield what is wrong with an item, and its index."""
    for index, key, why in flow_problems(mission.item):
        yield index, f"{key}: {why}"
    for index, item in enumerate(mission.item):
        if (kind := kind_of(item)) is not None:
            for problem in kind.problems(item, robot):
                yield index, problem
