"""Directions of the pixels: the lens inverted, once for all pictures.

Directions are in the fan's frame: x forward along `yaw_deg` of the mount, y left, z up, level, its
origin below the optical centre on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_sim.config.camera_parameters import CameraMount, Intrinsics

_STEPS = 40


@dataclass(frozen=True, slots=True, eq=False)
class PixelRays:
    """One ray for the centre of each pixel, (height, width).

    Attributes
    ----------
    ahead, left
        Unit vector of the ray's level direction.
    slope
        Rise over level distance; negative where it meets the floor.
    turn_rad
        Angle between the rays of neighbouring pixels of a row [rad].
    """

    ahead: np.ndarray
    left: np.ndarray
    slope: np.ndarray
    turn_rad: float


def pixel_rays(intrinsics: Intrinsics, mount: CameraMount) -> PixelRays:
    """Return the rays of all pixels.

    Raises
    ------
    ValueError
        If the distortion folds the picture, so that a pixel has no unique direction.
    """
    u, v = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    points = np.stack(
        [(u - intrinsics.cx_px) / intrinsics.fx_px, (v - intrinsics.cy_px) / intrinsics.fy_px]
    )
    x, y = _undistorted(points, intrinsics.distortion)
    # Camera: x right, y down, z ahead. Here: x ahead, y left, z up.
    rays = np.stack([np.ones_like(x), -x, -y]) / np.sqrt(1.0 + x * x + y * y)
    rays = np.einsum("ij,jvu->ivu", _attitude(mount), rays)
    level = np.maximum(np.hypot(rays[0], rays[1]), 1.0e-9)
    return PixelRays(rays[0] / level, rays[1] / level, rays[2] / level, 1.0 / intrinsics.fx_px)


def _attitude(mount: CameraMount) -> np.ndarray:
    """Rotation Ry(pitch) Rx(roll) from the camera, written ahead, left, up, to the fan's frame."""
    pitch, roll = math.radians(mount.pitch_deg), math.radians(mount.roll_deg)
    c, s = math.cos(pitch), math.sin(pitch)
    down = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = math.cos(roll), math.sin(roll)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    rotation: np.ndarray = down @ lean
    return rotation


def _undistorted(points: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Invert the lens model by Newton's method, (2, ...); Brown (1966) in OpenCV's form."""
    k1, k2, p1, p2, k3 = distortion
    xy = points.copy()
    error, limit = np.inf, 1.0e-12 * max(1.0, np.abs(points).max())
    for _ in range(_STEPS):
        x, y = xy
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        growth = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
        error_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - points[0]
        error_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - points[1]
        xx = radial + x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x
        xy_ = x * y * growth + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x
        area = xx * yy - xy_ * xy_
        if not np.all(area > 0.0):
            raise ValueError("distortion: folds the picture; these numbers are those of no lens")
        xy = np.stack(
            [x - (yy * error_x - xy_ * error_y) / area, y - (xx * error_y - xy_ * error_x) / area]
        )
        error = max(np.abs(error_x).max(), np.abs(error_y).max())
        if error < limit:
            return xy
    raise ValueError(
        f"distortion: after {_STEPS} steps of Newton's method a pixel's direction is still wrong "
        f"by {error:.1e} of the focal length; these numbers are those of no lens"
    )
