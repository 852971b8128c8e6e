"""The room: walls, boxes, furniture and obstacles of a TOML.

A world's file has a table `[world]` (name, bounds, start pose), perhaps a table `[floor]`
(`texture`, `seed`), `[[lamp]]` (`at`, `power`) and `[[board]]` (a chessboard on the floor) for the
camera, and any number of

- `[[wall]]`: `points` of a polyline, `closed` or not, `thickness_m` (0: a bare line, else each
  straight part becomes a rectangle about it),
- `[[box]]`: `centre`, `size`, `heading_deg`,
- `[[furniture]]`: a named `kind = "box"`, or a round `kind = "pillar"` with `centre` and
  `radius_m`, drawn as a polygon of `sides` sides about the circle,
- `[[obstacle]]`: objects on the floor that are on no map: `centre`, `radius_m` or `size`,
  `height_m`,
- `[[person]]`: a walking person: `points` of a closed path, `speed_m_s`.

Each may have a `height_m` (default 2.5 m for walls, 0.8 m for boxes and furniture) and a `colour`
(`#rrggbb`, default drawn from the floor's seed). The robot touches all of them and the camera sees
all of them; a sonar or a lidar sees what is higher than its mount. The map that robotctl makes
of a world has walls, boxes and furniture, not the obstacles and people. Everything is within
500 m of the origin.

A ROS map, `.yaml`, is a world too: its occupied cells are walls of 2.5 m, on an evenly lit floor of
tiles; the robot starts where there is the most room.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from firmware_sim.config.config import read_toml, validate
from firmware_sim.config.quantities import Positive, Real, closed
from firmware_sim.errors import SimulationError
from firmware_sim.world.cells import Cells
from firmware_sim.world.ros_map import SUFFIXES, load_cells
from firmware_sim.world.shapes import (
    WALL_M,
    Board,
    Box,
    Marker,
    Obstacle,
    Person,
    Pillar,
    Thing,
    Wall,
)

OBSTACLE = "obstacle"
FARTHEST_M = 500.0
"""Maximum distance of anything from the origin [m], which bounds the grid of collisions."""
_TOUCHING_M = 1.0e-6
_PLACES_M = 0.1
_MOST_PLACES = 250_000
_CELLS_COLOUR = "#d6d2ca"


@closed
@dataclass(frozen=True, slots=True)
class StartPose:
    """Start pose of the robot."""

    x_m: Real
    y_m: Real
    heading_deg: Real = 0.0


@closed
@dataclass(frozen=True, slots=True)
class WorldSection:
    """The table `[world]`.

    `bounds` is min x, min y, max x, max y of the area for robots; the extent of all objects by
    default.
    """

    name: str
    start: StartPose
    bounds: tuple[Real, Real, Real, Real] | None = None

    def __post_init__(self) -> None:
        if self.bounds is None:
            return
        low_x, low_y, high_x, high_y = self.bounds
        if not (low_x < high_x and low_y < high_y):
            raise ValueError("bounds: allowed are min x, min y, max x, max y")


@closed
@dataclass(frozen=True, slots=True)
class Floor:
    """The table `[floor]`: its material, and the seed of its pattern and of all colours."""

    texture: Literal["carpet", "concrete", "tiles", "wood"] = "tiles"
    seed: Annotated[int, Field(strict=True, ge=0)] = 0


@closed
@dataclass(frozen=True, slots=True)
class Lamp:
    """A lamp at x, y, z [m]; `power` 1 lights the floor below it equally from any height."""

    at: tuple[Real, Real, Positive]
    power: Positive = 1.0


@dataclass(frozen=True, slots=True)
class WorldFile:
    """A world's file as it is written."""

    world: WorldSection
    wall: tuple[Wall, ...] = ()
    box: tuple[Box, ...] = ()
    furniture: tuple[Annotated[Box | Pillar, Field(discriminator="kind")], ...] = ()
    obstacle: tuple[Obstacle, ...] = ()
    person: tuple[Person, ...] = ()
    floor: Floor = Floor()
    lamp: tuple[Lamp, ...] = ()
    board: tuple[Board, ...] = ()
    marker: tuple[Marker, ...] = ()

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


_FILE: TypeAdapter[WorldFile] = TypeAdapter(WorldFile)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A room in the plane.

    Attributes
    ----------
    name
        Name in messages.
    segments
        Walls, (n, 4): from x, y to x, y [m] in world, with the sides of boxes and furniture but not
        of obstacles.
    corners
        Square or nearly square corners as seen from inside, (m, 6): x, y of the corner [m] and the
        unit vectors of both arms. A sonar's echo comes back from them from any direction between
        the arms.
    bounds
        Area for robots: min x, min y, max x, max y [m].
    start
        Start pose: x [m], y [m], heading [rad].
    things
        All objects, in the order of the segments; obstacles last.
    floor
        The floor, for the camera.
    lamps
        Lamps; none: ceiling lamps about 3.6 m apart.
    boards
        Printed chessboards on the floor.
    markers
        Printed markers on things.
    people
        People of the world's file; a run may add others.
    cells
        Cells of a world that is a map; else None.
    """

    name: str
    segments: np.ndarray
    corners: np.ndarray
    bounds: tuple[float, float, float, float]
    start: tuple[float, float, float]
    things: tuple[Thing, ...] = ()
    floor: Floor = Floor()
    lamps: tuple[Lamp, ...] = ()
    boards: tuple[Board, ...] = ()
    markers: tuple[Marker, ...] = ()
    people: tuple[Person, ...] = ()
    cells: Cells | None = None

    @property
    def solids(self) -> tuple[tuple[str, np.ndarray], ...]:
        """Name and corners, (k, 2) [m], of the solid objects."""
        return tuple((thing.name, thing.corners) for thing in self.things if thing.solid)

    @property
    def touchable(self) -> np.ndarray:
        """Sides of everything that a robot can hit, (n, 4) [m]: the segments, then obstacles."""
        low = _sides(thing for thing in self.things if thing.kind == OBSTACLE)
        return np.ascontiguousarray(np.vstack([self.segments, low]))

    def seen_from(self, height_m: float) -> World:
        """Return the world visible to a level sensor at a height: objects higher than it."""
        seen = tuple(thing for thing in self.things if thing.height_m > height_m)
        if seen == tuple(thing for thing in self.things if thing.kind != OBSTACLE):
            return self
        segments = _sides(seen)
        corners = _inner_corners(segments)
        return dataclasses.replace(self, segments=segments, corners=corners, things=seen)

    def solid_at(self, x_m: float, y_m: float) -> str:
        """Name of the box, furniture or thick wall around a point; "" if none."""
        if self.cells is not None and self.cells.is_occupied(np.array([[x_m, y_m]]))[0]:
            return "a wall"
        for name, ring in self.solids:
            following = np.roll(ring, -1, axis=0)
            crosses = (ring[:, 1] > y_m) != (following[:, 1] > y_m)
            a, b = ring[crosses], following[crosses]
            at = a[:, 0] + (y_m - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
            if np.count_nonzero(at > x_m) % 2:
                return name
        return ""

    def is_known(self, x_m: float, y_m: float) -> bool:
        """Whether a point is in the room: in a map, in a free cell."""
        return self.cells is None or bool(self.cells.is_free(np.array([[x_m, y_m]]))[0])

    def places(self, x_m: float, y_m: float) -> np.ndarray:
        """Points where a robot might be put, the nearest to x, y [m] first, (n, 2) [m].

        They are 0.1 m apart, or more in a large world, and may be near a wall.
        """
        low_x, low_y, high_x, high_y = self.bounds
        step_m = max(_PLACES_M, math.sqrt((high_x - low_x) * (high_y - low_y) / _MOST_PLACES))
        x, y = np.arange(low_x, high_x, step_m), np.arange(low_y, high_y, step_m)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        if self.cells is not None:
            points = points[self.cells.is_free(points)]
        order = np.argsort(np.hypot(*(points - (x_m, y_m)).T), kind="stable")
        chosen: np.ndarray = points[order]
        return chosen

    @staticmethod
    def from_segments(
        segments: np.ndarray | list[tuple[float, float, float, float]],
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        name: str = "segments",
    ) -> World:
        """Build a world of bare wall segments, (n, 4) [m]; n may be 0."""
        array = np.ascontiguousarray(segments, dtype=np.float64).reshape(-1, 4)
        if not np.all(np.isfinite(array)):
            raise ValueError("segments: not finite")
        if np.any(np.hypot(array[:, 2] - array[:, 0], array[:, 3] - array[:, 1]) < _TOUCHING_M):
            raise ValueError("segments: a wall without length")
        things = tuple(
            Thing(f"wall {i}", "wall", row.reshape(2, 2), solid=False, height_m=WALL_M)
            for i, row in enumerate(array)
        )
        return World(name, array, _inner_corners(array), _extent(array, start), start, things)


_OTHERS: Final = {"item": "mission", "fault": "scenario of faults", "drive": "robot's file"}
"""Kind of a file with such a table that is not a world."""


def load_world(path: Path) -> World:
    """Read and validate a world's file, or a map.

    Raises
    ------
    SimulationError
        If the file cannot be read or is invalid; one line for each error.
    """
    if path.suffix.lower() in SUFFIXES:
        return _world_of(load_cells(path), path)
    table = read_toml(path)
    other = next((_OTHERS[key] for key in _OTHERS if key in table.data), None)
    if other is not None and not isinstance(table.data.get("world"), dict):
        raise SimulationError(f"{path}: is a {other}; a world is needed")
    file = validate(_FILE, table)
    things = tuple(_things(file, path))
    for thing in things:
        _check_near(thing.corners, thing.name, path)
    segments = _sides(thing for thing in things if thing.kind != OBSTACLE)
    start = file.world.start
    pose = (start.x_m, start.y_m, math.radians(start.heading_deg))
    low_x, low_y, high_x, high_y = bounds = file.world.bounds or _extent(_sides(things), pose)
    _check_near(np.array([*pose[:2], *bounds]), "world.start or world.bounds", path)
    if not (low_x <= pose[0] <= high_x and low_y <= pose[1] <= high_y):
        raise SimulationError(
            f"{path}: world.start: ({pose[0]}, {pose[1]}) is outside the bounds {bounds}"
        )
    return World(
        name=file.world.name,
        segments=segments,
        corners=_inner_corners(segments),
        bounds=bounds,
        start=pose,
        things=things,
        floor=file.floor,
        lamps=file.lamp,
        boards=file.board,
        markers=file.marker,
        people=file.person,
    )


def _world_of(cells: Cells, path: Path) -> World:
    """Return the world of a map's cells."""
    if not cells.free.any():
        raise SimulationError(
            f"{path}: no cell is free, so there is no place for a robot: are negate, free_thresh "
            "and "
            "occupied_thresh right?"
        )
    segments = cells.walls()
    ends = segments.reshape(-1, 2)
    if len(ends):
        _check_near(ends, "origin and size", path)
    walls = Thing("walls", "wall", ends, False, WALL_M, _CELLS_COLOUR, chained=False)
    *start, _ = cells.clear_way()
    return World(
        name=path.stem,
        segments=segments,
        corners=cells.corners(),
        bounds=cells.bounds(),
        start=(start[0], start[1], start[2]),
        things=(walls,) if len(ends) else (),
        cells=cells,
    )


def _check_near(places: np.ndarray, what: str, path: Path) -> None:
    """Raise SimulationError if a coordinate [m] is too far from the origin."""
    farthest = float(np.abs(places).max())
    if farthest > FARTHEST_M:
        raise SimulationError(
            f"{path}: {what}: has a coordinate of {farthest:g} m; allowed are {FARTHEST_M:g} m "
            "either side of the origin"
        )


def _sides(things: Iterable[Thing]) -> np.ndarray:
    """Sides of all things, (n, 4): from x, y to x, y [m]."""
    return np.ascontiguousarray(np.vstack([np.empty((0, 4)), *(each.sides() for each in things)]))


def _extent(
    sides: np.ndarray, start: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """Min x, min y, max x, max y of sides and start [m]."""
    points = np.vstack([sides.reshape(-1, 2), [start[:2]]])
    (low_x, low_y), (high_x, high_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return low_x, low_y, high_x, high_y


def _things(file: WorldFile, path: Path) -> Iterator[Thing]:
    """Yield what the file describes; raises SimulationError if two of its points coincide."""
    groups: tuple[tuple[str, Sequence[Wall | Box | Pillar | Obstacle]], ...] = (
        ("wall", file.wall),
        ("box", file.box),
        ("furniture", file.furniture),
        (OBSTACLE, file.obstacle),
    )
    for key, group in groups:
        for i, each in enumerate(group):
            for thing in things_of(each, key):
                sides = thing.sides()
                if np.any(np.hypot(*(sides[:, 2:] - sides[:, :2]).T) < _TOUCHING_M):
                    raise SimulationError(f"{path}: {key}.{i} ({each.name}): two points coincide")
                yield thing


def things_of(part: Wall | Box | Pillar | Obstacle, key: str) -> Iterator[Thing]:
    """Yield what a part of a file, of the table `key`, describes."""
    kind = part.kind if isinstance(part, Box | Pillar) else key
    solid = not isinstance(part, Wall) or part.thickness_m > 0.0
    for chain in part.outlines():
        corners = np.array(chain[:-1] if solid else chain)
        yield Thing(part.name, kind, corners, solid, part.height_m, part.colour or "")


def _inner_corners(segments: np.ndarray) -> np.ndarray:
    """Corners of 60° to 120° where two walls meet, or one ends at another, (m, 6)."""
    found: list[tuple[float, ...]] = []
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    unit = (segments[:, 2:] - segments[:, :2]) / length[:, None]
    ends = segments.reshape(-1, 2, 2)
    low_x, low_y = (ends.min(axis=1) - 1.0e-5).T
    high_x, high_y = (ends.max(axis=1) + 1.0e-5).T
    for i in range(len(segments)):
        for end, arm in ((segments[i, :2], unit[i]), (segments[i, 2:], -unit[i])):
            x, y = end
            for j in np.flatnonzero((low_x < x) & (x < high_x) & (low_y < y) & (y < high_y)):
                (ox, oy), (ux, uy) = end - segments[j, :2], unit[j]
                along, aside = ox * ux + oy * uy, abs(ox * uy - oy * ux)
                if not (aside < 1.0e-6 and -1.0e-6 < along < length[j] + 1.0e-6):
                    continue
                if abs(ux * arm[0] + uy * arm[1]) > 0.5:
                    continue
                other = [-unit[j]] if along > 1.0e-6 else []
                if along < length[j] - 1.0e-6:
                    other.append(unit[j])
                # A corner of two ends is found twice, once from each wall.
                both_ends = len(other) == 1
                if both_ends and j < i:
                    continue
                found += [(*end, *arm, *direction) for direction in other]
    return np.array(found, dtype=np.float64).reshape(-1, 6)
