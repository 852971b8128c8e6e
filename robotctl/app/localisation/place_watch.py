"""Recognises places while the robot drives: whenever it has turned once on the spot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from robotctl.errors import ConfigError
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.fix import place_fix
from robotctl.estimation.places.signature_turn import TurnCollector
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.maps.place_file import load_book
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading


class Fix(NamedTuple):
    """Likelihood of a recognised place, at the time of the turn's last reading."""

    stamp_ns: int
    log_likelihood: LogLikelihood


class PlaceWatch:
    """Collects sonar readings and compares each turn on the spot with the known places.

    Parameters
    ----------
    book
        The known places.
    mounts
        Mounting of the sonars.
    area_m2
        Of the floor on which the robot can be [m^2], > 0.
    """

    def __init__(self, book: PlaceBook, mounts: Sequence[SonarMount], area_m2: float) -> None:
        self._book = book
        self._turns = TurnCollector(mounts, book.signatures)
        self._area_m2 = area_m2
        self._notices: list[str] = []

    def hear(self, reading: SonarReading, odometry: SE2) -> Fix | None:
        """Add a reading with its odometry pose; return the result of a turn that it completes."""
        turn = self._turns.add(reading, odometry)
        if turn is None:
            return None
        found = self._book.suggest(turn.signature)
        if found.found is None:
            self._notices.append(f"no place is recognised: {found.refusal}")
        else:
            self._notices.append(f"the place {found.found.place} is recognised by its sonars")
        fix = place_fix(found, self._area_m2)
        return None if fix is None else Fix(turn.stamp_ns, fix)

    def take_notices(self) -> list[str]:
        """Return sentences on places recognised since the last call."""
        notices, self._notices = self._notices, []
        return notices


def find_places(name: str, beside: Path) -> Path:
    """Return the file of places, which may not be there.

    A relative path counts from the folder `beside`, that of the robot's file, then from the
    working directory.
    """
    here = beside / name
    return here if here.is_file() else Path(name)


def load_place_watch(
    name: str, beside: Path, mounts: Sequence[SonarMount], area_m2: float
) -> PlaceWatch | None:
    """Return the watch for the places of the file that `find_places` finds; None without a name.

    Raises
    ------
    ConfigError
        If there is no such file, it is wrong, or the robot has no sonars.
    """
    if not name:
        return None
    if not mounts:
        raise ConfigError(
            f"localisation.places: {name}: places are recognised by sonars, and this robot has none"
        )
    return PlaceWatch(load_book(find_places(name, beside)), mounts, area_m2)
