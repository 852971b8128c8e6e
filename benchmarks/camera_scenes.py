"""Rooms with things in them, pictures of them by the simulated camera, and the truth about both.

The truth is the geometry of the world, not what the renderer drew: ranges are those of a ray to the
nearest side, and an obstacle is one that should be seen if all of its foot is in the picture and
nothing stands before it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_sim.camera.camera import Camera
from firmware_sim.config.camera_parameters import CameraParameters
from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.world.shapes import Box, Obstacle, Pillar, Thing
from firmware_sim.world.world import Floor, Lamp, World, load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.sensors.camera_geometry import CameraGeometry

TEXTURES = ("tiles", "wood", "carpet", "concrete")
_CLEARANCE_M = 0.3
_OVEREXPOSED = 0.1
"""Share of the pixels of a picture that may be saturated."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One picture and where it was taken.

    Attributes
    ----------
    picture
        (height, width, 3) uint8, blue, green, red.
    pose
        Of base in world: x, y, theta [m, m, rad].
    world
        What stands around.
    sides
        Of all that stands there, (n, 4) [m] in world.
    owner
        The thing of each side, (n,).
    label
        Floor and light, for the table.
    """

    picture: NDArray[np.uint8]
    pose: tuple[float, float, float]
    world: World
    sides: NDArray[np.float64]
    owner: NDArray[np.intp]
    label: str

    def in_base(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the world, (n, 2), in base."""
        x, y, theta = self.pose
        c, s = math.cos(theta), math.sin(theta)
        d = points - [x, y]
        return np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], axis=1)

    def ranges(
        self, x_m: float, y_m: float, angles_rad: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return range and thing of the nearest side of rays from a point of base, (n,) each."""
        a, b = self.in_base(self.sides[:, :2]), self.in_base(self.sides[:, 2:])
        along = b - a
        d = np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=1)[:, None, :]
        start = a - [x_m, y_m]
        with np.errstate(divide="ignore", invalid="ignore"):
            across = d[..., 0] * along[:, 1] - d[..., 1] * along[:, 0]
            t = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
            s = (start[:, 0] * d[..., 1] - start[:, 1] * d[..., 0]) / across
        t = np.where((t > 1e-6) & (s >= 0.0) & (s <= 1.0), t, np.inf)
        nearest = np.argmin(t, axis=1)
        return t[np.arange(len(t)), nearest], self.owner[nearest]


@functools.cache
def geometry() -> CameraGeometry:
    """Return the camera of configs/diff_drive.toml as robotctl believes it to be."""
    camera = load_robot(find_file("diff_drive")).camera
    assert camera is not None
    return CameraGeometry.of(camera)


def office_shots(rng: np.random.Generator, worlds: int, poses: int) -> Iterator[Shot]:
    """Yield pictures from free places of the office, on all floors in turn, in any light."""
    office = load_world(find_file("office", "worlds"))
    for k in range(worlds):
        yield from _shots(rng, office, TEXTURES[k % len(TEXTURES)], poses)


def cluttered_shots(
    rng: np.random.Generator, worlds: int, poses: int, *, obstacles: bool = True
) -> Iterator[Shot]:
    """Yield pictures of rooms of 6 m by 5 m with furniture and obstacles of 5 to 30 cm."""
    room = load_world(find_file("clutter", "worlds"))
    walls = tuple(thing for thing in room.things if thing.kind == "wall")
    for k in range(worlds):
        things = (*walls, *_furniture(rng), *(_obstacles(rng) if obstacles else ()))
        segments = np.vstack([t.sides() for t in things if t.kind != "obstacle"])
        lamps = tuple(_lamp(rng) for _ in range(rng.integers(1, 4)))
        world = dataclasses.replace(room, things=things, segments=segments, lamps=lamps)
        yield from _shots(rng, world, TEXTURES[k % len(TEXTURES)], poses)


def _shots(rng: np.random.Generator, world: World, texture: str, poses: int) -> Iterator[Shot]:
    world = dataclasses.replace(world, floor=Floor(texture, int(rng.integers(1000))))
    light = dataclasses.replace(
        load_simulated_robot(find_file("diff_drive")).simulation.camera,
        exposure=float(rng.uniform(0.5, 1.0)),
        ambient=float(rng.uniform(0.4, 0.8)),
        read_noise=float(rng.uniform(1.0, 3.0)),
    )
    sides = np.vstack([thing.sides() for thing in world.things])
    owner = np.repeat(np.arange(len(world.things)), [len(t.sides()) for t in world.things])
    targets = [t.corners.mean(axis=0) for t in world.things if t.kind == "obstacle"]
    taken = [_free_pose(rng, world, sides, targets) for _ in range(poses)]
    pictures, light = _exposed(world, taken, light, int(rng.integers(99)))
    label = f"{texture}, exposure {light.exposure:.2f}, ambient {light.ambient:.2f}"
    for pose, picture in zip(taken, pictures, strict=True):
        yield Shot(picture, pose, world, sides, owner, label)


def _exposed(
    world: World, poses: list[tuple[float, float, float]], light: CameraParameters, seed: int
) -> tuple[list[NDArray[np.uint8]], CameraParameters]:
    """Take pictures, less exposed until hardly any of them is too bright, as a camera would."""
    robot = load_simulated_robot(find_file("diff_drive"))
    while True:
        simulation = dataclasses.replace(robot.simulation, camera=light)
        camera = Camera(dataclasses.replace(robot, simulation=simulation), world, seed)
        pictures = [camera.look(*pose, k).picture for k, pose in enumerate(poses)]
        bright = max(float(np.mean(picture.max(axis=2) >= 255)) for picture in pictures)
        if bright <= _OVEREXPOSED:
            return pictures, light
        light = dataclasses.replace(light, exposure=0.8 * light.exposure)


def _free_pose(
    rng: np.random.Generator,
    world: World,
    sides: NDArray[np.float64],
    targets: list[NDArray[np.float64]],
) -> tuple[float, float, float]:
    """Return a pose at which the robot and the floor right before it are free.

    Where there are obstacles it looks about where one of them is.
    """
    low_x, low_y, high_x, high_y = world.bounds
    while True:
        x, y = rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)
        theta = rng.uniform(-math.pi, math.pi)
        if targets:
            target = targets[rng.integers(len(targets))]
            away = rng.uniform(0.9, 2.2)
            x, y = target - away * np.array([math.cos(theta), math.sin(theta)])
            theta += rng.uniform(-0.4, 0.4)
            if not (low_x < x < high_x and low_y < y < high_y):
                continue
        ahead = np.arange(0.0, 0.95, 0.05)[:, None] * [math.cos(theta), math.sin(theta)] + [x, y]
        a, b = sides[:, :2], sides[:, 2:]
        along = b - a
        t = np.clip(
            np.sum((ahead[:, None] - a) * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0
        )
        gaps = np.linalg.norm(a + t[..., None] * along - ahead[:, None], axis=2)
        if gaps.min() > _CLEARANCE_M and not world.solid_at(x, y):
            return float(x), float(y), float(theta)


def _lamp(rng: np.random.Generator) -> Lamp:
    at = (float(rng.uniform(0.3, 5.7)), float(rng.uniform(0.3, 4.7)), float(rng.uniform(1.2, 2.5)))
    return Lamp(at, float(rng.uniform(0.5, 2.0)))


def _thing(shape: Box | Pillar | Obstacle, kind: str) -> Thing:
    (chain,) = shape.outlines()
    return Thing(shape.name, kind, np.array(chain[:-1]), True, shape.height_m, "")


def _furniture(rng: np.random.Generator) -> list[Thing]:
    things = []
    for _ in range(rng.integers(1, 4)):
        centre = (float(rng.uniform(0.5, 5.5)), float(rng.uniform(0.5, 4.5)))
        size = (float(rng.uniform(0.4, 1.2)), float(rng.uniform(0.3, 0.6)))
        heading, height = float(rng.uniform(0, 180)), float(rng.uniform(0.3, 1.2))
        things.append(_thing(Box(centre, size, heading, height_m=height), "box"))
    return things


def _obstacles(rng: np.random.Generator) -> list[Thing]:
    things = []
    for _ in range(rng.integers(6, 12)):
        centre = (float(rng.uniform(0.3, 5.7)), float(rng.uniform(0.3, 4.7)))
        width, height = float(rng.uniform(0.05, 0.3)), float(rng.uniform(0.05, 0.3))
        if rng.random() < 0.4:
            shape = Obstacle(centre, height, radius_m=width / 2)
        else:
            size = (width, float(np.clip(width * rng.uniform(0.6, 1.6), 0.05, 0.3)))
            shape = Obstacle(centre, height, size=size, heading_deg=float(rng.uniform(0, 180)))
        things.append(_thing(shape, "obstacle"))
    return things
