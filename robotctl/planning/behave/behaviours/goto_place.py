"""The behaviour that drives to a place of a topological map, as missions ask for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from robotctl.messages.requests import PlaceRequest
from robotctl.planning.behave.behaviours.goto import Piloted
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot
from robotctl.toml_source import nearest


@dataclass(frozen=True, slots=True)
class GotoPlaceItem:
    """Drive to a place of `navigation.pilot.topology` by recognising places.

    Parameters
    ----------
    kind
        Always "goto_place".
    place
        Its name.
    start
        Where the robot is when it begins; empty: it recognises that.
    speed_m_s
        Largest speed [m/s], > 0; None: that of positions from a ground station.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0; None: when its tries are used up.
    """

    kind: Literal["goto_place"]
    place: str
    start: str = ""
    speed_m_s: float | None = None
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "speed_m_s", "time_out_s")


def place_problems(wanted: GotoPlaceItem | PlaceRequest, places: tuple[str, ...]) -> Iterator[str]:
    """Yield why a robot that knows some places cannot drive to another."""
    if not places:
        yield "this robot knows no places: navigation.pilot.topology names no map of them"
        return
    for key, name in (("place", wanted.place), ("start", wanted.start)):
        if name not in places and (name or key == "place"):
            yield f"{key}: no place {name!r}{nearest(name, places)}"


def _problems(item: GotoPlaceItem, robot: Abilities) -> Iterator[str]:
    return place_problems(item, robot.places)


def _make(item: GotoPlaceItem, robot: NavigatedRobot) -> Piloted:
    speed_m_s = item.speed_m_s or robot.config.guided_speed_m_s
    return Piloted(lambda pilot: pilot.travel(item.place, item.start, speed_m_s), robot)


def _time_out_s(item: GotoPlaceItem) -> float | None:
    return item.time_out_s


def _make_guided(wanted: PlaceRequest, robot: NavigatedRobot) -> Piloted:
    return _make(GotoPlaceItem("goto_place", wanted.place, wanted.start), robot)


GOTO_PLACE = Kind(_make, _time_out_s, _problems, piloted=True)
GUIDED_PLACE = Kind(_make_guided)
