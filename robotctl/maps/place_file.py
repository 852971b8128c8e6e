"""The file of the places that a robot knows: TOML, also readable for people.

A visit is two rows of numbers, from forward of `base` to the left, at its end: the median depth of
the echoes [m], nan without echoes, and the share of silence, nan without readings.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

import numpy as np

from robotctl import toml_source
from robotctl.errors import ConfigError, InvalidValue
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.places import Place, Visit
from robotctl.estimation.places.signatures import Signature, SignatureConfig
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.atomic_file import write_whole

VERSION: Final = 1
_IN_A_LINE: Final = 12
_HEAD: Final = """\
# Places that a robot knows by its sonars, from `robotctl places learn`; see docs/places.md.
# depth_m and silence have a number for each bearing, from forward to the left: the median depth
# of the echoes (nan: none), and the share of readings without one (nan: no sonar looked there).
"""


@dataclass(frozen=True)
class VisitEntry:
    """A `[[place.visit]]`: `base` at its end, and the readings."""

    x_m: float
    y_m: float
    heading_deg: float
    depth_m: tuple[float, ...]
    silence: tuple[float, ...]

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m", "heading_deg"):
            if not math.isfinite(getattr(self, key)):
                raise InvalidValue(
                    key, f"must be finite, found {getattr(self, key)}", getattr(self, key)
                )
        _ = self.value

    @cached_property
    def value(self) -> Visit:
        """The entry as a visit."""
        pose = SE2(self.x_m, self.y_m, wrap_angle(math.radians(self.heading_deg)))
        return Visit(pose, Signature(np.array(self.depth_m), np.array(self.silence)))


@dataclass(frozen=True)
class PlaceEntry:
    """A `[[place]]`; `frame` is that of its visits' poses, "own" for the first visit's."""

    name: str
    frame: Literal["world", "own"]
    visit: tuple[VisitEntry, ...]

    def __post_init__(self) -> None:
        _ = self.value

    @cached_property
    def value(self) -> Place:
        """The entry as a place."""
        return Place(self.name, self.frame == "world", tuple(each.value for each in self.visit))


@dataclass(frozen=True)
class BookFile:
    """The whole file."""

    version: int
    bearings: int
    max_range_m: float
    depth_sigma_m: float
    place: tuple[PlaceEntry, ...] = ()

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise ValueError(f"version {self.version} of the file found, {VERSION} is read")
        _ = self.value

    @cached_property
    def value(self) -> PlaceBook:
        """The file as a book."""
        signatures = SignatureConfig(self.bearings, self.max_range_m, self.depth_sigma_m)
        return PlaceBook([entry.value for entry in self.place], signatures)


def load_book(path: Path) -> PlaceBook:
    """Read the places of a file.

    Raises
    ------
    ConfigError
        If it is missing, damaged or invalid, with one line for each error.
    """
    return toml_source.load(path, BookFile).value


def save_book(path: Path, book: PlaceBook) -> None:
    """Write the places into a file, atomically.

    Raises
    ------
    ConfigError
        If it cannot be written.
    """
    try:
        write_whole(path, "\n".join(_lines(book)) + "\n")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def _lines(book: PlaceBook) -> Iterator[str]:
    """Yield the lines of the file."""
    config = book.signatures
    yield f"{_HEAD}\nversion = {VERSION}"
    yield f"bearings = {config.bearings}"
    yield f"max_range_m = {config.max_range_m!r}"
    yield f"depth_sigma_m = {config.depth_sigma_m!r}"
    for place in book.places:
        yield f"\n[[place]]\nname = {json.dumps(place.name, ensure_ascii=False)}"
        yield f'frame = "{"world" if place.in_world else "own"}"'
        for visit in place.visits:
            pose, heard = visit.pose, visit.signature
            yield f"\n[[place.visit]]\nx_m = {pose.x_m:.4f}\ny_m = {pose.y_m:.4f}"
            yield f"heading_deg = {math.degrees(pose.theta_rad):.3f}"
            yield from _row("depth_m", [f"{depth:.3f}" for depth in heard.depth_m.tolist()])
            # Rounding must not turn a silence with rare echoes into one without any.
            most = np.where(np.isnan(heard.depth_m), 1.0, 0.9999)
            shares = np.minimum(heard.silence, most).tolist()
            yield from _row("silence", [f"{share:.4f}" for share in shares])


def _row(key: str, numbers: Sequence[str]) -> Iterator[str]:
    """Yield the lines of an array."""
    yield f"{key} = ["
    for begin in range(0, len(numbers), _IN_A_LINE):
        yield f"    {', '.join(numbers[begin : begin + _IN_A_LINE])},"
    yield "]"
