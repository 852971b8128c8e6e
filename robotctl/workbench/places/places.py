"""`robotctl places`: learn places by their sonar signatures, and recognise them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotctl import toml_source
from robotctl.config.robot_file import RobotConfig, config_directory, find_file, load_robot
from robotctl.errors import ConfigError, PlaceError
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.places import SonarRecognition
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.maps.place_file import load_book, save_book
from robotctl.maps.world import find_world
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.clock import RealClock
from robotctl.toml_source import nearest
from robotctl.workbench.places.live import live_turn
from robotctl.workbench.places.options import PlaceSource
from robotctl.workbench.places.sim import simulated_turn
from robotctl.workbench.places.turns import Progress, Visited, recorded_turns

_ONE_PLACE_M: Final = 0.3
"""Distance beyond which turns of a recording are at different places."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A `[[mark]]` on the floor of a world."""

    name: str
    x_m: float
    y_m: float
    heading_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Marks:
    """A file of marks."""

    mark: tuple[Mark, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Recognised:
    """A turn, its end pose, and the recognition."""

    visited: Visited
    recognition: SonarRecognition


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """The new book, and the other places that the new visit would have been taken for."""

    book: PlaceBook
    alike: tuple[str, ...]


def learn(
    name: str,
    book: Path,
    source: PlaceSource,
    progress: Progress,
    tell: Callable[[str], None] = lambda _: None,
) -> Learned:
    """Add a place, or another visit to one, to a file; `tell` is called with notes on a log.

    Raises
    ------
    ConfigError
        If a file or a setting is wrong.
    LogFormatError
        If a log cannot be read.
    SimulatorError
        If the robot cannot be simulated.
    PlaceError
        If there is no turn on the spot, or it says nothing that matches the place.
    """
    robot = load_robot(find_file(str(source.robot)), source.overrides)
    if book.exists():
        known = load_book(book)
    else:
        reach_m = robot.localisation.sonar.max_range_m
        known = PlaceBook(signatures=SignatureConfig(max_range_m=reach_m))
    alike: set[str] = set()
    for visited in _at_one_place(_turns(source, robot, known.signatures, name, progress, tell)):
        candidates = known.suggest(visited.turn.signature).candidates
        alike |= {each.place for each in candidates} - {name}
        try:
            known = known.learned(name, visited.turn.signature, visited.pose)
        except ValueError as error:
            raise PlaceError(f"{name} is not learnt: {error}") from error
    save_book(book, known)
    return Learned(known, tuple(sorted(alike)))


def recognise(
    book: Path,
    source: PlaceSource,
    progress: Progress,
    tell: Callable[[str], None] = lambda _: None,
) -> list[Recognised]:
    """Return the recognised place of each turn on the spot; `tell` as in `learn`.

    Raises
    ------
    ConfigError, LogFormatError, SimulatorError, PlaceError
        As `learn`.
    """
    robot = load_robot(find_file(str(source.robot)), source.overrides)
    known = load_book(book)
    return [
        Recognised(visited, known.suggest(visited.turn.signature))
        for visited in _turns(source, robot, known.signatures, "", progress, tell)
    ]


def _turns(
    source: PlaceSource,
    robot: RobotConfig,
    signatures: SignatureConfig,
    name: str,
    progress: Progress,
    tell: Callable[[str], None],
) -> list[Visited]:
    """Return the turns of a source; `name` is the mark of a world where none is given."""
    if not source.world:
        began = _pose(source.at) if source.at else None
        if source.log is not None:
            return recorded_turns(source.log, robot.sonar, signatures, began, tell)
        return [live_turn(source.live, robot, signatures, began, progress, RealClock())]
    world = find_world(source.world)
    at = source.at or name
    start = _pose(at) if "," in at else marked(world, at)
    path = find_file(str(source.robot))
    return [
        simulated_turn(
            path, robot, source.overrides, world, start, source.seed, signatures, progress
        )
    ]


def _at_one_place(found: Sequence[Visited]) -> Sequence[Visited]:
    """Return the turns of a recording if they are all at one place."""
    first = found[0].turn
    for each in found[1:]:
        apart = first.odometry.inverse() @ each.turn.odometry
        if math.hypot(apart.x_m, apart.y_m) > _ONE_PLACE_M:
            seconds = ", ".join(f"{1e-9 * one.turn.stamp_ns:.1f} s" for one in found)
            raise PlaceError(
                f"the robot turns at several places (turns end at {seconds}): learn a place from a "
                "recording of one turn"
            )
    return found


def _pose(text: str) -> SE2:
    """Return the pose `X,Y` or `X,Y,HEADING` [m, m, deg]."""
    try:
        numbers = [float(word) for word in text.split(",")]
        if len(numbers) not in {2, 3} or not all(map(math.isfinite, numbers)):
            raise ValueError
    except ValueError:
        raise ConfigError(
            f"--at {text}: needed is X,Y or X,Y,HEADING in m and deg, such as 3.0,2.0,90"
        ) from None
    heading_deg = numbers[2] if len(numbers) == 3 else 0.0
    return SE2(numbers[0], numbers[1], wrap_angle(math.radians(heading_deg)))


def marked(world: Path, name: str) -> SE2:
    """Return the pose of a mark of a world.

    Raises
    ------
    ConfigError
        If the world has no marks, or none of that name.
    """
    file = config_directory() / "places" / world.name
    if not file.is_file():
        raise ConfigError(f"--at {name or 'is missing'}: {world.stem} has no marks, X,Y is needed")
    marks = {mark.name: mark for mark in toml_source.load(file, Marks).mark}
    if name not in marks:
        raise ConfigError(
            f"--at {name or 'is missing'}: neither X,Y,HEADING nor a mark of {world.stem}"
            f"{nearest(name, list(marks))}"
        )
    mark = marks[name]
    return SE2(mark.x_m, mark.y_m, wrap_angle(math.radians(mark.heading_deg)))
