"""The file of a topological map: TOML, also readable for people."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from robotctl import toml_source
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.planning.map.topological.graph import (
    Exit,
    Passage,
    PlaceView,
    TopologicalMap,
    TopologicalPlace,
)
from robotctl.runtime.storage.atomic_file import write_whole

VERSION: Final = 2
_READ: Final = (1, VERSION)
"""Readable versions. Version 1 has no exits and views: routes can be found, but not driven."""
_HEAD: Final = """\
# Places and passages, from `robotctl topology`; see docs/planning.md. A place lists its passages
# counter-clockwise. Bearings are from its middle, counter-clockwise from its first passage. x_m and
# y_m, of the map that it was made of, may be left out.
"""


@dataclass(frozen=True)
class TopologyFile:
    """The whole file."""

    version: int
    place: tuple[TopologicalPlace, ...]
    passage: tuple[Passage, ...] = ()

    def __post_init__(self) -> None:
        if self.version not in _READ:
            read = " and ".join(map(str, _READ))
            raise ValueError(f"version {self.version} of the file found, {read} are read")
        _ = self.value

    @cached_property
    def value(self) -> TopologicalMap:
        """The file as a map."""
        return TopologicalMap(self.place, self.passage)


def load_topology(path: Path) -> TopologicalMap:
    """Read a topological map.

    Raises
    ------
    ConfigError
        If it is missing, damaged or invalid, with one line for each error.
    """
    return toml_source.load(path, TopologyFile).value


def find_topology(name: str, beside: Path) -> Path:
    """Return the file of a topological map that a robot's file, in the folder `beside`, names.

    Raises
    ------
    ConfigError
        If there is no such file.
    """
    return find_file(name, "places", beside=beside)


def load_places(name: str, beside: Path) -> TopologicalMap | None:
    """Read the topological map that `find_topology` finds, for driving; None without a name.

    Raises
    ------
    ConfigError
        If there is no such file, it is invalid, or it lacks data for driving.
    """
    if not name:
        return None
    file = find_topology(name, beside)
    topology = load_topology(file)
    if topology.undrivable:
        raise ConfigError(
            f"{file}: {topology.undrivable}; `robotctl topology build` makes one anew"
        )
    return topology


def save_topology(topology: TopologicalMap, path: Path) -> None:
    """Write a topological map, atomically.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    write_whole(path, "\n".join(_lines(topology)) + "\n")


def _lines(topology: TopologicalMap) -> Iterator[str]:
    yield f"{_HEAD}\nversion = {VERSION}"
    for place in topology.places:
        yield f"\n[[place]]\nname = {_text(place.name)}\nkind = {_text(place.kind)}"
        yield f"passages = [{', '.join(map(_text, place.passages))}]"
        yield f"area_m2 = {place.area_m2:.2f}\nwidth_m = {place.width_m:.2f}"
        yield from _position(place)
        yield _depth(place)
        for each in place.exit:
            yield f"[[place.exit]]\npassage = {_text(each.passage)}\n{_polar(each)}"
            yield f"heading_deg = {each.heading_deg:.1f}"
        for view in place.view:
            yield f"[[place.view]]\n{_polar(view)}\n{_depth(view)}"
    for passage in topology.passages:
        yield f"\n[[passage]]\nname = {_text(passage.name)}"
        yield f"between = [{', '.join(map(_text, passage.between))}]"
        yield f"width_m = {passage.width_m:.2f}\nlength_m = {passage.length_m:.2f}"
        yield from _position(passage)


def _position(item: TopologicalPlace | Passage) -> Iterator[str]:
    if math.isfinite(item.x_m + item.y_m):
        yield f"x_m = {item.x_m:.3f}\ny_m = {item.y_m:.3f}"


def _polar(item: Exit | PlaceView) -> str:
    return f"bearing_deg = {item.bearing_deg:.1f}\ndistance_m = {item.distance_m:.2f}"


def _depth(item: TopologicalPlace | PlaceView) -> str:
    return f"depth_m = [{', '.join(f'{each:.2f}' for each in item.depth_m)}]"


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
