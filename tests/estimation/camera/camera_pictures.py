"""Pictures of boxes on a floor, ray by ray: an independent eye for the tests of the camera.

Light comes from a lamp of some width, so shadows have soft edges; it is computed in linear light
and stored as cameras do, with the gamma of sRGB, after blur and noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry

Colour = tuple[float, float, float]
Texture = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

LENS = CameraIntrinsics(320, 240, 250.0, 250.0, 159.5, 119.5, (-0.12, 0.02, 0.0, 0.0, 0.0))
"""Half of the usual size: the tests would take four times as long."""
MOUNT = CameraMount(0.1, 0.0, 0.3, 0.0, 20.0, 0.0)
CAMERA = CameraGeometry(LENS, MOUNT)


@dataclass(frozen=True)
class Block:
    """A box on the floor: centre, heading, length along it and across, height, colour (BGR)."""

    x: float
    y: float
    length: float
    width: float
    height: float
    colour: Colour = (0.2, 0.3, 0.6)
    heading: float = 0.0

    def local(self, x, y):
        """Return points in the axes of the box."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        dx, dy = x - self.x, y - self.y
        return c * dx + s * dy, c * dy - s * dx

    def crossed(self, o, d):
        """Return where rays o + t d enter, inf if they do not, and the axis of the face."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        ox, oy = self.local(o[..., 0], o[..., 1])
        dx, dy = c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0]
        near, far = np.full(dx.shape, -np.inf), np.full(dx.shape, np.inf)
        axis = np.zeros(dx.shape, int)
        sides = (
            (ox, dx, -self.length / 2, self.length / 2),
            (oy, dy, -self.width / 2, self.width / 2),
            (o[..., 2], d[..., 2], 0.0, self.height),
        )
        for k, (at, along, low, high) in enumerate(sides):
            with np.errstate(divide="ignore", invalid="ignore"):
                a, b = (low - at) / along, (high - at) / along
            first, last = np.minimum(a, b), np.maximum(a, b)
            axis = np.where(first > near, k, axis)
            near, far = np.fmax(near, first), np.fmin(far, last)
        return np.where((near < far) & (near > 1e-6), near, np.inf), axis


def even(colour: Colour = (0.35, 0.4, 0.45)) -> Texture:
    """A floor of one colour."""
    return lambda x, y: np.broadcast_to(colour, (*x.shape, 3))


def sampled(table, x, y):
    """Return a table at any place, bilinear, repeated without end."""
    n = len(table)
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    a, b = x - i, y - j
    i0, j0, i1, j1 = i % n, j % n, (i + 1) % n, (j + 1) % n
    low = (1 - a) * table[i0, j0] + a * table[i1, j0]
    high = (1 - a) * table[i0, j1] + a * table[i1, j1]
    return (1 - b) * low + b * high


def speckled(colour: Colour = (0.35, 0.4, 0.45), contrast: float = 0.2, seed: int = 0) -> Texture:
    """A floor like terrazzo: smooth noise of three scales."""
    table = np.random.default_rng(seed).normal(size=(3, 256, 256)).astype(np.float32)

    def at(x, y):
        total = np.zeros(x.shape)
        for layer, scale_m in zip(table, (0.012, 0.04, 0.15), strict=True):
            total += sampled(layer, x / scale_m, y / scale_m)
        return np.array(colour) * np.exp(contrast * total / 1.7)[..., None]

    return at


def tiled(
    one: Colour = (0.5, 0.55, 0.6), other: Colour = (0.25, 0.3, 0.38), side_m: float = 0.2
) -> Texture:
    """A floor of tiles of two colours with dark joints."""
    rough = speckled((1.0, 1.0, 1.0), 0.06, 1)

    def at(x, y):
        i, j = np.floor(x / side_m), np.floor(y / side_m)
        colour = np.where(((i + j) % 2 == 0)[..., None], one, other)
        joint = (x / side_m - i < 0.02) | (y / side_m - j < 0.02)
        return np.where(joint[..., None], 0.12, colour) * rough(x, y)

    return at


def planks(colour: Colour = (0.14, 0.27, 0.45)) -> Texture:
    """A floor of wood: planks of slightly different brown with grain."""
    grain = speckled((1.0, 1.0, 1.0), 0.15, 2)

    def at(x, y):
        row = np.floor(y / 0.12)
        shade = 1.0 + 0.25 * np.sin(row * 12.9898 + np.floor(x / 0.9 + 0.37 * row) * 78.233)
        return np.array(colour) * shade[..., None] * grain(x * 0.15, y)

    return at


@dataclass(frozen=True)
class Scene:
    """What stands where, on what floor, in what light."""

    blocks: tuple[Block, ...] = ()
    floor: Texture = field(default_factory=speckled)
    walls: tuple[Block, ...] = ()
    lamp: tuple[float, float, float] = (0.5, 1.0, 1.6)
    lamp_width: float = 0.15
    direct: float = 0.6
    brightness: float = 0.8
    noise: float = 2.0
    blur_px: float = 0.6
    texture: float = 0.1

    def ranges(self, x: float, y: float, bearings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far it is on the floor to the first block or wall, (n,) [m]."""
        o = np.tile([x, y, 1e-3], (len(bearings), 1))
        d = np.stack([np.cos(bearings), np.sin(bearings), np.zeros_like(bearings)], axis=1)
        return np.min([b.crossed(o, d)[0] for b in (*self.blocks, *self.walls)], axis=0)

    def picture(self, camera: CameraGeometry, seed: int = 0) -> NDArray[np.uint8]:
        """Return what the camera sees, BGR; four rays a pixel."""
        rng = np.random.default_rng(seed)
        rows, columns = camera.intrinsics.height_px, camera.intrinsics.width_px
        v, u = np.mgrid[0 : 2 * rows, 0 : 2 * columns] / 2.0 - 0.25
        d = camera.rays_base(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(*u.shape, 3)
        o = np.broadcast_to(camera.t_base_camera, d.shape)
        solid = (*self.blocks, *self.walls)
        with np.errstate(divide="ignore"):
            best = np.where(d[..., 2] < 0.0, -o[..., 2] / d[..., 2], np.inf)
        which, face = np.full(best.shape, -1), np.zeros(best.shape, int)
        for k, block in enumerate(solid):
            t, axis = block.crossed(o, d)
            nearer = t < best
            best, which = np.where(nearer, t, best), np.where(nearer, k, which)
            face = np.where(nearer, axis, face)
        best = np.where(best < 60.0, best, 60.0)
        point = o + best[..., None] * d
        colour = np.array(self.floor(point[..., 0], point[..., 1]))
        grain = speckled((1.0, 1.0, 1.0), self.texture, 5)
        for k, block in enumerate(solid):
            mine = which == k
            if mine.any():
                bright = np.array([0.75, 1.0, 1.15])[face[mine]]
                p = point[mine]
                rough = grain(p[:, 0] + p[:, 1], p[:, 2])
                colour[mine] = np.array(block.colour) * bright[:, None] * rough
        colour[(d[..., 2] >= 0.0) & (which < 0)] = (0.5, 0.5, 0.5)
        lit = self._lit(point) if self.direct > 0.0 else np.ones(best.shape)
        lit = np.where(which < 0, lit, 1.0)
        light = self.brightness * (1.0 - self.direct + self.direct * lit)
        linear = cv2.resize(
            (colour * light[..., None]).astype(np.float32),
            (columns, rows),
            interpolation=cv2.INTER_AREA,
        )
        if self.blur_px > 0.0:
            linear = cv2.GaussianBlur(linear, (0, 0), self.blur_px)
        stored = 255.0 * np.clip(linear, 0.0, 1.0) ** (1.0 / 2.2)
        stored += rng.normal(0.0, self.noise, stored.shape)
        return np.clip(np.rint(stored), 0, 255).astype(np.uint8)

    def _lit(self, point):
        """Return the share of the lamp that points of the floor see; walls cast no shadow."""
        lit = np.zeros(point.shape[:2])
        offsets = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
        for a, b in offsets:
            towards = np.array(self.lamp) + self.lamp_width * np.array([a, b, 0.0])
            free = np.ones(point.shape[:2], bool)
            start = point + np.array([0.0, 0.0, 1e-4])
            for block in self.blocks:
                t, _ = block.crossed(start, np.broadcast_to(towards, point.shape))
                free &= ~np.isfinite(t)
            lit += free
        return lit / len(offsets)


def room(distance: float = 3.0, colour: Colour = (0.55, 0.7, 0.75)) -> tuple[Block, ...]:
    """Three walls about the robot, of which the front one is at a distance."""
    return (
        Block(distance + 0.05, 0.0, 0.1, 8.0, 2.5, colour),
        Block(0.0, 2.0, 12.0, 0.1, 2.5, colour),
        Block(0.0, -2.2, 12.0, 0.1, 2.5, colour),
    )
