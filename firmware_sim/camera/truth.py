"""Measurements of a perfect camera on the robot, to score image processing.

Nothing here is shared with what draws them (`camera_fan`, `camera_view`, `camera_lens`): every ray
is cut with every side, and points are projected forwards through the lens.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_sim.config.camera_parameters import CameraMount, Intrinsics
from firmware_sim.world.shapes import Thing
from firmware_sim.world.world import World

_SAMPLES = 24
"""Points on each side of a foot that are projected into the picture."""
_TOGETHER = 256
"""Sides that rays are intersected with at once."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A thing whose foot is in the picture.

    Attributes
    ----------
    name, kind
        Name and kind in the world's file.
    x_m, y_m
        Middle of its foot, in base.
    near_x_m, near_y_m
        Nearest point of its foot to the camera, in base.
    front_x_m, front_y_m
        Point of its foot halfway in bearing between its left and right end, in base.
    height_m
        Height of the thing.
    seen
        Share of the foot of its visible sides that is in the picture and not hidden, (0, 1].
    """

    name: str
    kind: str
    x_m: float
    y_m: float
    near_x_m: float
    near_y_m: float
    front_x_m: float
    front_y_m: float
    height_m: float
    seen: float


def true_ranges(
    world: World, pose: tuple[float, float, float], mount: CameraMount, angles_rad: np.ndarray
) -> np.ndarray:
    """Return the level distances to the first foot of anything.

    Parameters
    ----------
    world
        The room.
    pose
        Pose of base in world: x, y [m], heading [rad].
    mount
        Mount of the true camera (`Camera.mount`); ranges begin below its optical centre.
    angles_rad
        Directions in base, (n,) [rad].

    Returns
    -------
    ndarray
        (n,) [m]; inf if there is nothing.
    """
    x, y = _camera_place(pose, mount)
    bearings = pose[2] + np.asarray(angles_rad, dtype=np.float64)
    ray = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return _first_met(world.touchable, x, y, ray)


def _first_met(sides: np.ndarray, x: float, y: float, ray: np.ndarray) -> np.ndarray:
    """Return the distance from a point to the first side along each ray, (n,) [m]."""
    nearest = np.full(len(ray), np.inf)
    apart = _distances(sides, x, y)
    order = np.argsort(apart)
    for begin in range(0, len(order), _TOGETHER):
        chosen = order[begin : begin + _TOGETHER]
        if apart[chosen[0]] > nearest.max(initial=0.0):
            break
        nearest = np.minimum(nearest, _met(sides[chosen], x, y, ray).min(axis=0))
    return nearest


def _distances(sides: np.ndarray, x: float, y: float) -> np.ndarray:
    """Return the distance of each side, (n, 4), from a point, (n,) [m]."""
    along = sides[:, 2:] - sides[:, :2]
    offset = (x, y) - sides[:, :2]
    share = np.clip(np.sum(offset * along, axis=1) / np.sum(along * along, axis=1), 0.0, 1.0)
    apart: np.ndarray = np.hypot(*(offset - share[:, None] * along).T)
    return apart


def _met(sides: np.ndarray, x: float, y: float, ray: np.ndarray) -> np.ndarray:
    """Return the fraction of its length at which each ray from a point hits a side; inf: never.

    The result for sides (k, 4) and rays (n, 2) is (k, n).
    """
    ax, ay, bx, by = sides.T[..., None]
    ex, ey = bx - ax, by - ay
    across = ray[:, 0] * ey - ray[:, 1] * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = ((ax - x) * ey - (ay - y) * ex) / across
        along = ((ax - x) * ray[:, 1] - (ay - y) * ray[:, 0]) / across
    return np.where((lengths > 0.0) & (along >= 0.0) & (along <= 1.0), lengths, np.inf)


def project(points_base: np.ndarray, intrinsics: Intrinsics, mount: CameraMount) -> np.ndarray:
    """Return the pixels of points in base, (n, 3) [m], as (n, 2) [px]; nan behind the camera."""
    yaw, pitch, roll = (
        math.radians(angle) for angle in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg)
    )
    offset = points_base - np.array([mount.x_m, mount.y_m, mount.z_m])
    x = math.cos(yaw) * offset[:, 0] + math.sin(yaw) * offset[:, 1]
    left = -math.sin(yaw) * offset[:, 0] + math.cos(yaw) * offset[:, 1]
    ahead = math.cos(pitch) * x - math.sin(pitch) * offset[:, 2]
    up = math.sin(pitch) * x + math.cos(pitch) * offset[:, 2]
    left, up = (
        math.cos(roll) * left + math.sin(roll) * up,
        -math.sin(roll) * left + math.cos(roll) * up,
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = np.where(ahead > 1.0e-6, (-left / ahead, -up / ahead), np.nan)
    k1, k2, p1, p2, k3 = intrinsics.distortion
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack(
        [intrinsics.fx_px * u + intrinsics.cx_px, intrinsics.fy_px * v + intrinsics.cy_px], axis=1
    )


def sightings(
    world: World, pose: tuple[float, float, float], intrinsics: Intrinsics, mount: CameraMount
) -> list[Sighting]:
    """Return the objects, no walls, in the true camera's picture (`Camera.intrinsics`, `.mount`).

    `pose` is that of base in world: x, y [m], heading [rad].
    """
    found = []
    for thing in world.things:
        if thing.kind == "wall":
            continue
        foot = _visible_foot(thing, pose, mount)
        if len(foot) == 0:
            continue
        inside = _in_picture(_to_base(foot, pose), intrinsics, mount)
        seen = inside & ~_hidden(foot, thing, world, pose, mount)
        if not np.any(seen):
            continue
        middle = _to_base(thing.corners.mean(axis=0, keepdims=True), pose)[0]
        found.append(
            Sighting(
                thing.name,
                thing.kind,
                float(middle[0]),
                float(middle[1]),
                *_near(thing, pose, mount),
                *_front(thing, pose, mount),
                thing.height_m,
                float(np.mean(seen)),
            )
        )
    return found


def _camera_place(pose: tuple[float, float, float], mount: CameraMount) -> tuple[float, float]:
    """Place below the camera, in world [m]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + c * mount.x_m - s * mount.y_m, pose[1] + s * mount.x_m + c * mount.y_m


def _to_base(points: np.ndarray, pose: tuple[float, float, float]) -> np.ndarray:
    """Points of the floor from world to base, (n, 2) [m]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turned: np.ndarray = (points - np.array(pose[:2])) @ np.array([[c, -s], [s, c]])
    return turned


def _near(
    thing: Thing, pose: tuple[float, float, float], mount: CameraMount
) -> tuple[float, float]:
    """Return the point of a foot that is nearest to the camera, in base [m]."""
    corners = _to_base(thing.corners, pose) - [mount.x_m, mount.y_m]
    along = np.roll(corners, -1, axis=0) - corners
    share = -np.sum(corners * along, axis=1) / np.sum(along * along, axis=1)
    points = corners + np.clip(share, 0.0, 1.0)[:, None] * along
    x, y = points[np.argmin(np.hypot(points[:, 0], points[:, 1]))]
    return mount.x_m + float(x), mount.y_m + float(y)


def _front(
    thing: Thing, pose: tuple[float, float, float], mount: CameraMount
) -> tuple[float, float]:
    """Return the point of a foot halfway in bearing between its ends, in base [m]."""
    corners = _to_base(thing.corners, pose) - [mount.x_m, mount.y_m]
    # Bearings relative to the centre's, from which no corner is half a turn away.
    x, y = corners.mean(axis=0)
    aside = np.arctan2(x * corners[:, 1] - y * corners[:, 0], corners @ [x, y])
    middle = math.atan2(y, x) + 0.5 * (aside.min() + aside.max())
    ray = np.array([[math.cos(middle), math.sin(middle)]])
    sides = np.hstack([corners, np.roll(corners, -1, axis=0)])
    (distance,) = _first_met(sides, 0.0, 0.0, ray)
    return mount.x_m + distance * ray[0, 0], mount.y_m + distance * ray[0, 1]


def _visible_foot(thing: Thing, pose: tuple[float, float, float], mount: CameraMount) -> np.ndarray:
    """Points on the foot of the sides that face the camera, evenly, (n, 2) in world [m]."""
    place = np.array(_camera_place(pose, mount))
    middle = thing.corners.mean(axis=0)
    points = []
    for side in thing.sides():
        a, b = side[:2], side[2:]
        normal = np.array([b[1] - a[1], a[0] - b[0]])
        outward = normal if normal @ (a - middle) > 0.0 else -normal
        if outward @ (place - a) > 0.0:
            points.append(a + (np.arange(_SAMPLES)[:, None] + 0.5) / _SAMPLES * (b - a))
    return np.vstack(points) if points else np.empty((0, 2))


def _in_picture(foot_base: np.ndarray, intrinsics: Intrinsics, mount: CameraMount) -> np.ndarray:
    """Whether each point of the floor is within the picture, (n,)."""
    points = np.column_stack([foot_base, np.zeros(len(foot_base))])
    u, v = project(points, intrinsics, mount).T
    with np.errstate(invalid="ignore"):
        inside: np.ndarray = (
            (u >= -0.5)
            & (u <= intrinsics.width_px - 0.5)
            & (v >= -0.5)
            & (v <= intrinsics.height_px - 0.5)
        )
    return inside


def _hidden(
    foot: np.ndarray,
    thing: Thing,
    world: World,
    pose: tuple[float, float, float],
    mount: CameraMount,
) -> np.ndarray:
    """Whether another object hides each point of a foot from the camera, (n,)."""
    place = _camera_place(pose, mount)
    ray = foot - np.array(place)
    hidden = np.zeros(len(foot), dtype=bool)
    for other in world.things:
        if other is thing:
            continue
        t = _met(other.sides(), *place, ray)
        # The line of sight has come down to z_m (1 - t) where it meets a side.
        hides = (t < 1.0 - 1.0e-6) & (mount.z_m * (1.0 - t) <= other.height_m)
        hidden |= hides.any(axis=0)
    return hidden
