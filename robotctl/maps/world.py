"""The walls of a world's file, for localisation.

This is robotctl's own reading: `firmware_sim.world` has another, and tests compare the two. It
reads the parts of a world that are on a map: `[[wall]]`, `[[box]]` and `[[furniture]]`. Obstacles
and people are on none; only the simulator reads floor, lamps and boards, for its camera.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np

from robotctl import toml_source
from robotctl.config.robot_file import MAPS, TOML, find_file
from robotctl.errors import ConfigError, InvalidValue
from robotctl.maps.map_file import refuse_image
from robotctl.model.wall_map import WallMap

FARTHEST_M: Final = 500.0
"""Maximum distance of any wall from the origin [m], which bounds the cells of a map."""
_TOUCHING_M: Final = 1.0e-6

Point: TypeAlias = tuple[float, float]
Outline: TypeAlias = list[Point]
"""A chain of corners [m], closed if the last equals the first."""


def find_world(name: str, beside: Path | None = None) -> Path:
    """Return the file of a world, `.toml`, or of a ROS map, `.yaml`, as found by `find_file`.

    `beside` is the folder of the file that names it.

    Raises
    ------
    ConfigError
        If there is no such file.
    """
    refuse_image(name)
    return find_file(name, "worlds", (*TOML, *MAPS), beside=beside).resolve()


@dataclass(frozen=True, slots=True)
class _Wall:
    """A polyline, or a row of rectangles about its parts if it has a thickness."""

    points: tuple[Point, ...]
    closed: bool = False
    thickness_m: float = 0.0
    name: str = "wall"
    height_m: float = 2.5
    colour: str | None = None

    def __post_init__(self) -> None:
        if len(self.points) < 2:
            raise InvalidValue(
                "points", f"must be two at least, found {len(self.points)}", self.points
            )
        if not 0.0 <= self.thickness_m < math.inf:
            raise InvalidValue(
                "thickness_m", f"must be 0 m or more, found {self.thickness_m}", self.thickness_m
            )

    def outlines(self) -> Iterator[Outline]:
        """Yield the polyline, or each rectangle."""
        points = [*self.points, self.points[0]] if self.closed else list(self.points)
        if self.thickness_m == 0.0:
            yield points
            return
        for a, b in itertools.pairwise(points):
            length_m = math.dist(a, b) or 1.0  # points that coincide are refused with the file
            nx = (a[1] - b[1]) / length_m * self.thickness_m / 2.0
            ny = (b[0] - a[0]) / length_m * self.thickness_m / 2.0
            first = a[0] - nx, a[1] - ny
            yield [first, (b[0] - nx, b[1] - ny), (b[0] + nx, b[1] + ny), (a[0] + nx, a[1] + ny),
                   first]  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Box:
    """A rectangle, turned by `heading_deg` about its centre."""

    centre: Point
    size: tuple[float, float]
    heading_deg: float = 0.0
    name: str = "box"
    kind: Literal["box"] = "box"
    height_m: float = 0.8
    colour: str | None = None

    def __post_init__(self) -> None:
        if not all(0.0 < side_m < math.inf for side_m in self.size):
            raise InvalidValue(
                "size", f"must be two lengths above 0 m, found {self.size}", self.size
            )
        if not math.isfinite(self.heading_deg):
            raise InvalidValue(
                "heading_deg",
                f"must be a finite number of degrees, found {self.heading_deg}",
                self.heading_deg,
            )

    def outlines(self) -> Iterator[Outline]:
        """Yield its four sides."""
        c, s = math.cos(math.radians(self.heading_deg)), math.sin(math.radians(self.heading_deg))
        if self.heading_deg % 90.0 == 0.0:
            c, s = round(c), round(s)  # its sides are exactly along x and y
        (x, y), u, v = self.centre, self.size[0] / 2.0, self.size[1] / 2.0
        corners = ((-u, -v), (u, -v), (u, v), (-u, v), (-u, -v))
        yield [(x + c * a - s * b, y + s * a + c * b) for a, b in corners]


@dataclass(frozen=True, slots=True)
class _Pillar:
    """A round pillar: the regular polygon about its circle, with a corner in direction x."""

    kind: Literal["pillar"]
    centre: Point
    radius_m: float
    sides: int = 16
    name: str = "pillar"
    height_m: float = 0.8
    colour: str | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.radius_m < math.inf:
            raise InvalidValue(
                "radius_m", f"must be above 0 m, found {self.radius_m}", self.radius_m
            )
        if not 6 <= self.sides <= 128:
            raise InvalidValue("sides", f"must be 6 to 128, found {self.sides}", self.sides)

    def outlines(self) -> Iterator[Outline]:
        """Yield its sides."""
        (x, y), step_rad = self.centre, math.tau / self.sides
        r = self.radius_m / math.cos(math.pi / self.sides)
        angles = [step_rad * i for i in (*range(self.sides), 0)]
        yield [(x + r * math.cos(angle), y + r * math.sin(angle)) for angle in angles]


@dataclass(frozen=True, slots=True)
class _WorldFile:
    """A world's file; the tables without a type are the simulator's."""

    world: dict[str, Any]
    wall: tuple[_Wall, ...] = ()
    box: tuple[_Box, ...] = ()
    furniture: tuple[Annotated[_Box | _Pillar, toml_source.BY_KIND], ...] = ()
    obstacle: tuple[dict[str, Any], ...] = ()
    person: tuple[dict[str, Any], ...] = ()
    floor: dict[str, Any] = field(default_factory=dict)
    lamp: tuple[dict[str, Any], ...] = ()
    board: tuple[dict[str, Any], ...] = ()
    marker: tuple[dict[str, Any], ...] = ()

    def outlines(self) -> Iterator[tuple[toml_source.Key, Outline]]:
        """Yield the outlines of everything on a map, each with its key."""
        groups: tuple[tuple[str, Sequence[_Wall | _Box | _Pillar]], ...] = (
            ("wall", self.wall),
            ("box", self.box),
            ("furniture", self.furniture),
        )
        for key, group in groups:
            for i, each in enumerate(group):
                yield from (((key, i), outline) for outline in each.outlines())


def load_walls(world: Path) -> WallMap:
    """Return the walls of a world's file, `.toml`.

    Raises
    ------
    ConfigError
        If the file is invalid, or has no wall.
    """
    file = toml_source.load(world, _WorldFile, rules=_misplaced)
    sides = [(*a, *b) for _, outline in file.outlines() for a, b in itertools.pairwise(outline)]
    if not sides:
        raise ConfigError(f"{world}: no walls found; a robot needs at least one")
    return WallMap(np.array(sides, dtype=np.float64))


def _misplaced(file: _WorldFile) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield errors for walls too far away, and sides without length."""
    for key, outline in file.outlines():
        # Written so that nan is refused, too.
        far = [each for point in outline for each in point if not abs(each) <= FARTHEST_M]
        if far:
            allowed = f"allowed are {FARTHEST_M:g} m either side of the origin"
            yield key, f"has a coordinate of {far[0]:g} m; {allowed}"
        elif any(math.dist(a, b) < _TOUCHING_M for a, b in itertools.pairwise(outline)):
            yield key, "two points coincide"
