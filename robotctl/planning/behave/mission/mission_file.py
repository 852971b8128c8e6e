"""Mission files: what the robot shall do, step by step."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from typing import TYPE_CHECKING, Annotated, Union

from robotctl import toml_source
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.flow import FlowItem
from robotctl.planning.behave.behaviours.item import require_bounded
from robotctl.planning.behave.behaviours.registry import BEHAVIOURS
from robotctl.planning.behave.mission.flow import flow_problems
from robotctl.planning.behave.mission.zones import zone_problems
from robotctl.planning.config import RecoveryConfig
from robotctl.planning.map.zone import Zone

if TYPE_CHECKING:
    from robotctl.planning.behave.behaviours.item import Item
else:
    # As many as there are.
    Item = Union[(*filter(is_dataclass, BEHAVIOURS), FlowItem)]


@dataclass(frozen=True, slots=True)
class StartPose:
    """Pose of the robot at the start, in `world`."""

    x_m: float
    y_m: float
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        require_bounded(self, "x_m", "y_m", "heading_deg")

    @property
    def pose(self) -> SE2:
        """The pose `T_world_base`."""
        return SE2(self.x_m, self.y_m, math.radians(self.heading_deg))


@dataclass(frozen=True, slots=True)
class Mission:
    """Content of a mission file.

    Parameters
    ----------
    name
        Name shown to people.
    start
        Pose at the start.
    item
        The steps, at least one, written as `[[item]]`.
    world
        Name of the world's file that `robotctl sim` drives it in; empty: the user says which.
    zone
        What is to be kept out of or passed slowly by all that drives by plan, beside the zones of
        the robot's file, written as `[[zone]]`.
    recovery
        How patient all that drives by plan is; None: as the robot's file says.
    """

    name: str
    start: StartPose
    item: tuple[Annotated[Item, toml_source.BY_KIND], ...]
    world: str = ""
    zone: tuple[Zone, ...] = ()
    recovery: RecoveryConfig | None = None

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
    return toml_source.parse(text, Mission, file_name, rules=mission_rules)


def mission_rules(mission: Mission) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield what is wrong between the items of a file: key, and why."""
    for index, key, why in flow_problems(mission.item):
        yield ("item", index, key), why
    for index, key, why in zone_problems(mission.item, mission.zone):
        yield ("item", index, key), why
