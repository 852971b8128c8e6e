"""The room: walls, boxes and furniture of a TOML, as line segments.

A world's file has a table `[world]` (name, bounds, start pose) and any number of

- `[[wall]]`: `points` of a polyline, `closed` or not, `thickness_m` (0: a bare line, else each
  straight part becomes a rectangle about it),
- `[[box]]`: `centre`, `size`, `heading_deg`,
- `[[furniture]]`: a named `kind = "box"`, or a round `kind = "pillar"` with `centre` and
  `radius_m`, drawn as a polygon of `sides` sides about the circle.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, TypeAdapter

from firmware_sim.config import read_toml, validate
from firmware_sim.errors import SimulationError
from firmware_sim.parameters import NotNegative, Point, Positive, Real, closed

Corner: TypeAlias = tuple[float, float]


@closed
@dataclass(frozen=True, slots=True)
class StartPose:
    """Where the robot starts."""

    x_m: Real
    y_m: Real
    heading_deg: Real = 0.0


@closed
@dataclass(frozen=True, slots=True)
class WorldSection:
    """The table `[world]`; `bounds` is min x, min y, max x, max y, that of all walls if absent."""

    name: str
    start: StartPose
    bounds: tuple[Real, Real, Real, Real] | None = None


@closed
@dataclass(frozen=True, slots=True)
class Wall:
    """A polyline, or a row of rectangles about its parts where it has a thickness."""

    points: Annotated[tuple[Point, ...], Field(min_length=2)]
    closed: bool = False
    thickness_m: NotNegative = 0.0
    name: str = "wall"

    def outlines(self) -> list[list[Corner]]:
        """Chains of corners, each closed when its last corner is its first."""
        points = [*self.points, self.points[0]] if self.closed else list(self.points)
        if self.thickness_m == 0.0:
            return [points]
        chains = []
        for (ax, ay), (bx, by) in itertools.pairwise(points):
            length = math.hypot(bx - ax, by - ay)
            px = -(by - ay) / length * self.thickness_m / 2
            py = (bx - ax) / length * self.thickness_m / 2
            ring = [(ax - px, ay - py), (bx - px, by - py), (bx + px, by + py), (ax + px, ay + py)]
            chains.append([*ring, ring[0]])
        return chains


@closed
@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle, turned by `heading_deg` about its centre."""

    centre: Point
    size: tuple[Positive, Positive]
    heading_deg: Real = 0.0
    name: str = "box"
    kind: Literal["box"] = "box"

    def outlines(self) -> list[list[Corner]]:
        """Its four sides as one closed chain."""
        c, s = math.cos(math.radians(self.heading_deg)), math.sin(math.radians(self.heading_deg))
        if self.heading_deg % 90.0 == 0.0:
            c, s = round(c), round(s)
        u, v = self.size[0] / 2, self.size[1] / 2
        x, y = self.centre
        ring = [
            (x + c * a - s * b, y + s * a + c * b) for a, b in ((-u, -v), (u, -v), (u, v), (-u, v))
        ]
        return [[*ring, ring[0]]]


@closed
@dataclass(frozen=True, slots=True)
class Pillar:
    """A round pillar as a polygon about its circle."""

    kind: Literal["pillar"]
    centre: Point
    radius_m: Positive
    sides: Annotated[int, Field(strict=True, ge=6, le=128)] = 16
    name: str = "pillar"

    def outlines(self) -> list[list[Corner]]:
        """Its sides as one closed chain."""
        r = self.radius_m / math.cos(math.pi / self.sides)
        step = 2 * math.pi / self.sides
        x, y = self.centre
        ring = [(x + r * math.cos(step * i), y + r * math.sin(step * i)) for i in range(self.sides)]
        return [[*ring, ring[0]]]


@dataclass(frozen=True, slots=True)
class WorldFile:
    """A world's file as it is written."""

    world: WorldSection
    wall: tuple[Wall, ...] = ()
    box: tuple[Box, ...] = ()
    furniture: tuple[Annotated[Box | Pillar, Field(discriminator="kind")], ...] = ()

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


_FILE: TypeAdapter[WorldFile] = TypeAdapter(WorldFile)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A room in the plane.

    Attributes
    ----------
    name
        For messages.
    segments
        Walls, (n, 4): from x, y to x, y [m] in world.
    corners
        Square or nearly square corners as seen from inside, (m, 6): x, y of the corner [m] and the
        unit vectors of both arms. A sonar's echo comes back from them from any direction between
        the arms.
    bounds
        Min x, min y, max x, max y [m].
    start
        x [m], y [m], heading [rad].
    solids
        Name and corners, (k, 2) [m], of what has an inside: boxes, furniture and thick walls.
    """

    name: str
    segments: np.ndarray
    corners: np.ndarray
    bounds: tuple[float, float, float, float]
    start: tuple[float, float, float]
    solids: tuple[tuple[str, np.ndarray], ...] = ()

    def solid_at(self, x_m: float, y_m: float) -> str:
        """Name of the box, furniture or thick wall that a point is inside of; "" if none."""
        for name, ring in self.solids:
            following = np.roll(ring, -1, axis=0)
            crosses = (ring[:, 1] > y_m) != (following[:, 1] > y_m)
            a, b = ring[crosses], following[crosses]
            at = a[:, 0] + (y_m - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
            if np.count_nonzero(at > x_m) % 2:
                return name
        return ""

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
        if np.any(np.hypot(array[:, 2] - array[:, 0], array[:, 3] - array[:, 1]) < 1.0e-6):
            raise ValueError("segments: a wall without length")
        points = np.vstack([array[:, :2], array[:, 2:], np.array([start[:2]])])
        low, high = points.min(axis=0), points.max(axis=0)
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        return World(name, array, _inner_corners(array), bounds, start)


def load_world(path: Path) -> World:
    """Read and validate a world's file.

    Raises
    ------
    SimulationError
        The file cannot be read or is wrong; one line for each error.
    """
    file = validate(_FILE, read_toml(path), path)
    segments: list[tuple[float, float, float, float]] = []
    solids: list[tuple[str, np.ndarray]] = []
    for kind, things in (("wall", file.wall), ("box", file.box), ("furniture", file.furniture)):
        for i, thing in enumerate(things):
            for chain in thing.outlines():
                sides = [(*a, *b) for a, b in itertools.pairwise(chain)]
                if any(math.hypot(s[2] - s[0], s[3] - s[1]) < 1.0e-6 for s in sides):
                    raise SimulationError(f"{path}: {kind}.{i} ({thing.name}): two points coincide")
                segments += sides
                if not isinstance(thing, Wall) or thing.thickness_m > 0.0:
                    solids.append((thing.name, np.array(chain[:-1])))
    start = file.world.start
    pose = (start.x_m, start.y_m, math.radians(start.heading_deg))
    world = World.from_segments(segments, pose, file.world.name)
    low_x, low_y, high_x, high_y = bounds = file.world.bounds or world.bounds
    if not (low_x <= pose[0] <= high_x and low_y <= pose[1] <= high_y):
        raise SimulationError(
            f"{path}: world.start: ({pose[0]}, {pose[1]}) is outside the bounds {bounds}"
        )
    return World(world.name, world.segments, world.corners, bounds, pose, tuple(solids))


def _inner_corners(segments: np.ndarray) -> np.ndarray:
    """Corners of 60° to 120° where two walls meet, or one ends at another, (m, 6)."""
    found: list[tuple[float, ...]] = []
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    unit = (segments[:, 2:] - segments[:, :2]) / length[:, None]
    for i in range(len(segments)):
        for end, arm in ((segments[i, :2], unit[i]), (segments[i, 2:], -unit[i])):
            offset = end - segments[:, :2]
            along = np.sum(offset * unit, axis=1)
            aside = np.abs(offset[:, 0] * unit[:, 1] - offset[:, 1] * unit[:, 0])
            near = (aside < 1.0e-6) & (along > -1.0e-6) & (along < length + 1.0e-6)
            square = np.abs(unit @ arm) <= 0.5
            for j in np.flatnonzero(near & square):
                other = [-unit[j]] if along[j] > 1.0e-6 else []
                if along[j] < length[j] - 1.0e-6:
                    other.append(unit[j])
                # A corner of two ends is met twice, once from each wall.
                both_ends = len(other) == 1
                if both_ends and j < i:
                    continue
                found += [(*end, *arm, *direction) for direction in other]
    return np.array(found, dtype=np.float64).reshape(-1, 6)
