"""`robotctl topology` and `robotctl plan --topological`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robotctl import toml_source
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError, InvalidValue
from robotctl.maps.localisation_map import load_any_map
from robotctl.maps.topology_file import load_topology, save_topology
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.topological.build import Topology, build
from robotctl.planning.map.topological.graph import Step, TopologicalMap
from robotctl.toml_source import nearest
from robotctl.workbench.places.places import Marks


@dataclass(frozen=True, slots=True, eq=False)
class BuiltTopology:
    """A topological map and the metric one it was made of."""

    grid: GridMap
    topology: Topology


def build_topology(name: str, robot: Path, overrides: tuple[str, ...], marks: str) -> BuiltTopology:
    """Divide a map into places; a place with a mark gets its name.

    Parameters
    ----------
    name
        Of the map, or its file.
    robot, overrides
        Name or file of the robot, and `key=value` settings on top of it.
    marks
        Name or file of the marks; empty: none.

    Raises
    ------
    ConfigError
        If a file is wrong, the robot fits nowhere, two marks are at one place, or a mark has the
        name that another place keeps.
    """
    file = find_file(marks, "places") if marks else None
    wanted = toml_source.load(file, Marks).mark if file else ()
    robot_config = load_robot(robot, overrides)
    outline = robot_config.footprint
    grid = load_any_map(name, Path()).grid
    built = build(grid, outline.inscribed_m)
    topology = built.map
    if not topology.places:
        raise ConfigError(f"{name}: no place for {robot} in it")
    named: dict[int, str] = {}
    for mark in wanted:
        number = built.place_at(grid, mark.x_m, mark.y_m)
        if number is None:
            raise ConfigError(f"{file}: {mark.name} is at no place of {name}")
        if number in named:
            raise ConfigError(f"{file}: {named[number]} and {mark.name} are at one place of {name}")
        named[number] = mark.name
    try:
        for number, new in named.items():
            topology = topology.renamed(topology.places[number].name, new)
    except InvalidValue as error:
        raise ConfigError(f"{file}: {error}") from error
    return BuiltTopology(grid, Topology(topology, built.labels))


def rename_place(file: Path, old: str, new: str) -> None:
    """Give a place of a file another name.

    Raises
    ------
    ConfigError
        If the file is wrong, has no such place, or has the name already.
    OSError
        If it cannot be written.
    """
    topology = load_topology(file)
    _check_place(file, topology, old)
    try:
        save_topology(topology.renamed(old, new), file)
    except InvalidValue as error:
        raise ConfigError(f"{file}: {error}") from error


def find_way(file: Path, start: str, goal: str) -> list[Step] | None:
    """Return the way between two places of a file, None if there is none.

    Raises
    ------
    ConfigError
        If the file is wrong or has no such place.
    """
    topology = load_topology(file)
    for name in (start, goal):
        _check_place(file, topology, name)
    return topology.way(start, goal)


def _check_place(file: Path, topology: TopologicalMap, name: str) -> None:
    """Raise ConfigError if a file has no such place."""
    if topology.place(name) is None:
        known = nearest(name, [each.name for each in topology.places])
        raise ConfigError(f"{file}: no place {name!r}{known}")
