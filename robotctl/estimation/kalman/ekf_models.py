"""Expected measurements from a pose, with Jacobians: the measurement models of the EKF.

A model returns the expected measurement and its Jacobian H by (x, y, theta), `base` in `world`.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

Array: TypeAlias = NDArray[np.float64]


def landmark_sighting(pose: SE2, landmark_world: tuple[float, float]) -> tuple[Array, Array]:
    """Return expected (range [m], bearing [rad]) of a landmark, (2,), and H (2, 3).

    Source: Thrun, Burgard, Fox: Probabilistic Robotics, table 7.2. Not defined on the landmark.
    """
    dx, dy = landmark_world[0] - pose.x_m, landmark_world[1] - pose.y_m
    squared = dx * dx + dy * dy
    distance = math.sqrt(squared)
    expected = np.array([distance, math.atan2(dy, dx) - pose.theta_rad])
    H = np.array(
        [
            [-dx / distance, -dy / distance, 0.0],
            [dy / squared, -dx / squared, -1.0],
        ]
    )
    return expected, H


def bearing_residual(z: Array, z_predicted: Array) -> Array:
    """Return the difference of two (range, bearing), the bearing on the circle."""
    difference = z - z_predicted
    difference[1] = math.remainder(difference[1], math.tau)
    return difference


def pose_residual(z: Array, z_predicted: Array) -> Array:
    """Return the difference of two (x, y, theta), theta on the circle."""
    difference = z - z_predicted
    difference[2] = math.remainder(difference[2], math.tau)
    return difference


def wall_range(
    pose: SE2, mount: SonarMount, walls: WallMap, sonar: SonarModelConfig
) -> tuple[float, Array] | None:
    """Return the range [m] that a sonar should read, and H (3,); None if no echo is expected.

    The first surface in the cone counts: the foot of the perpendicular on a wall where the cone
    holds it (a region of constant depth: Leonard and Durrant-Whyte 1992, section 2), else the point
    that a ray of the cone hits. The nearest wall wins; met more flatly than the limit it sends
    nothing back and hides what is behind it.

    `wall_echoes.py` answers the same for thousands of poses, without H.
    """
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    ox, oy = c * mount.x_m - s * mount.y_m, s * mount.x_m + c * mount.y_m
    sensor = np.array([pose.x_m + ox, pose.y_m + oy])
    axis = pose.theta_rad + mount.heading_rad
    half_width_rad = math.radians(0.5 * sonar.beam_deg)
    ranges, incidences, gradients = _candidates(sensor, axis, walls.segments, half_width_rad)
    nearest = int(np.argmin(ranges))
    too_flat = incidences[nearest] > math.radians(sonar.max_incidence_deg)
    if not math.isfinite(ranges[nearest]) or too_flat:
        return None
    by_x, by_y, by_angle = (float(value) for value in gradients[nearest])
    # the heading turns the sensor about `base` and the axis with it
    return float(ranges[nearest]), np.array([by_x, by_y, -by_x * oy + by_y * ox + by_angle])


def _candidates(
    sensor: Array, axis_rad: float, segments: Array, half_width_rad: float
) -> tuple[Array, Array, Array]:
    """Return range, incidence and gradient by (sensor x, y, axis) of each echo; inf if none.

    Of each wall: the foot of the perpendicular, and one hit for each of three rays of the cone.
    """
    a, b = segments[:, :2], segments[:, 2:]
    along = b - a
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
    height = ((a - sensor) * normal).sum(axis=1)
    normal *= np.where(height < 0.0, -1.0, 1.0)[:, None]  # away from the sensor; walls have 2 sides
    height = np.abs(height)
    at_foot = ((sensor - a) * along).sum(axis=1) / length**2
    off_axis = np.arctan2(normal[:, 1], normal[:, 0]) - axis_rad
    off_axis = np.abs(np.remainder(off_axis + math.pi, math.tau) - math.pi)
    seen = (at_foot >= 0.0) & (at_foot <= 1.0) & (off_axis <= half_width_rad) & (height > 0.0)
    # rays along the axis and the edges, (rays, walls)
    offsets = np.array([-half_width_rad, 0.0, half_width_rad])
    c, s = np.cos(axis_rad + offsets)[:, None], np.sin(axis_rad + offsets)[:, None]
    cosine = normal[:, 0] * c + normal[:, 1] * s
    with np.errstate(divide="ignore", invalid="ignore"):
        m = height / cosine
        share = at_foot + m * (along[:, 0] * c + along[:, 1] * s) / length**2
        by_axis = -m * (normal[:, 1] * c - normal[:, 0] * s) / cosine
        by_place = -normal.T[:, None, :] / cosine
    met = (cosine > 0.0) & (height > 0.0) & (share >= 0.0) & (share <= 1.0)
    rays = np.stack([by_place[0], by_place[1], by_axis], axis=2).reshape(-1, 3)
    foot = np.stack([-normal[:, 0], -normal[:, 1], np.zeros(len(a))], axis=1)
    return (
        np.concatenate([np.where(seen, height, np.inf), np.where(met, m, np.inf).ravel()]),
        np.concatenate([np.zeros(len(a)), np.arccos(np.clip(cosine, -1.0, 1.0)).ravel()]),
        np.concatenate([foot, rays]),
    )
