"""The file of a topological map: TOML, for people too."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from robotctl import toml_source
from robotctl.planning.topological.graph import Passage, TopologicalMap, TopologicalPlace
from robotctl.runtime.storage.atomic_file import write_whole

VERSION: Final = 1
_HEAD: Final = """\
# Places and passages, from `robotctl topology`; see docs/planning.md. A place lists its passages
# counter-clockwise. x_m and y_m may be left out: a way needs no coordinates.
"""


@dataclass(frozen=True)
class TopologyFile:
    """The whole file."""

    version: int
    place: tuple[TopologicalPlace, ...]
    passage: tuple[Passage, ...] = ()

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise ValueError(f"version {self.version} of the file found, {VERSION} is read")
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
        If it is missing, damaged or wrong, with one line for each error.
    """
    return toml_source.load(path, TopologyFile).value


def save_topology(topology: TopologicalMap, path: Path) -> None:
    """Write a topological map, whole or not at all.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    write_whole(path, "\n".join(_lines(topology)) + "\n")


def _lines(topology: TopologicalMap) -> Iterator[str]:
    yield f"{_HEAD}\nversion = {VERSION}"
    for place in topology.places:
        yield f"\n[[place]]\nname = {_text(place.name)}\nkind = {_text(place.kind)}"
        yield f"passages = [{', '.join(map(_text, place.passages))}]"
        yield f"area_m2 = {place.area_m2:.2f}\nwidth_m = {place.width_m:.2f}"
        yield from _position(place)
        yield f"depth_m = [{', '.join(f'{each:.2f}' for each in place.depth_m)}]"
    for passage in topology.passages:
        yield f"\n[[passage]]\nname = {_text(passage.name)}"
        yield f"between = [{', '.join(map(_text, passage.between))}]"
        yield f"width_m = {passage.width_m:.2f}\nlength_m = {passage.length_m:.2f}"
        yield from _position(passage)


def _position(item: TopologicalPlace | Passage) -> Iterator[str]:
    if math.isfinite(item.x_m + item.y_m):
        yield f"x_m = {item.x_m:.3f}\ny_m = {item.y_m:.3f}"


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
