"""The behaviour that explores, as missions ask for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from robotctl.messages.requests import ExploreRequest
from robotctl.planning.behave.behaviours.goto import Piloted
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot


@dataclass(frozen=True, slots=True)
class ExploreItem:
    """Drive to what is unknown until the map is complete, as far as the robot can reach.

    Parameters
    ----------
    kind
        Always "explore".
    speed_m_s
        Largest speed [m/s], > 0; None: that of positions from a ground station.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0; None: never.
    """

    kind: Literal["explore"]
    speed_m_s: float | None = None
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "speed_m_s", "time_out_s")


def _make(item: ExploreItem, robot: NavigatedRobot) -> Piloted:
    speed_m_s = item.speed_m_s or robot.config.guided_speed_m_s
    return Piloted(lambda pilot: pilot.exploration(speed_m_s), robot)


def _time_out_s(item: ExploreItem) -> float | None:
    return item.time_out_s


def _make_guided(_wanted: ExploreRequest, robot: NavigatedRobot) -> Piloted:
    return _make(ExploreItem("explore"), robot)


EXPLORE = Kind(_make, _time_out_s, piloted=True)
GUIDED_EXPLORATION = Kind(_make_guided)
