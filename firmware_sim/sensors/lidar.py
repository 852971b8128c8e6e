"""A planar lidar, for estimators that need more than sonar; its scans do not fit on CAN."""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.parameters import LidarParameters
from firmware_sim.noise import noise_state, normal, uniform
from firmware_sim.sensors.rays import cast_fan, cast_rays, fan_angles
from firmware_sim.world.near import Near
from firmware_sim.world.world import World
from native_kernels.compiled import borrows, compiled


class Lidar:
    """Takes scans of the room, each at one instant or beam by beam as the robot moves.

    Parameters
    ----------
    parameters
        The sensor and its mount.
    world
        The room.
    rng
        Generator of noise and drop-outs.
    """

    def __init__(self, parameters: LidarParameters, world: World, rng: np.random.Generator) -> None:
        self.parameters = parameters
        offset_m = math.hypot(parameters.x_m, parameters.y_m)
        self.walls = Near(world.segments, parameters.max_range_m + offset_m)
        self._noise = noise_state(rng)
        self._angles = fan_angles(parameters.beams, math.radians(parameters.fov_deg))
        self._hits = np.empty(parameters.beams, dtype=np.int32)

    @property
    def angles_rad(self) -> np.ndarray:
        """Angles of the beams in base, (beams,), increasing from the right [rad]."""
        return self._angles + math.radians(self.parameters.heading_deg)

    @property
    def ages_s(self) -> np.ndarray:
        """Time of each beam before the scan's, (beams,) [s], of a lidar that sweeps."""
        ages = np.linspace(abs(self.parameters.sweep_s), 0.0, self.parameters.beams)
        return ages if self.parameters.sweep_s > 0.0 else ages[::-1].copy()

    def sweep(self, poses: np.ndarray) -> np.ndarray:
        """Measure each range, (beams,), from a pose of base in world of its own, (beams, 3)."""
        p = self.parameters
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        sensors = np.stack(
            [
                poses[:, 0] + cos * p.x_m - sin * p.y_m,
                poses[:, 1] + sin * p.x_m + cos * p.y_m,
                poses[:, 2] + self.angles_rad,
            ],
            axis=1,
        )
        ranges = np.empty(p.beams)
        walls = self.walls.at(float(poses[-1, 0]), float(poses[-1, 1]))
        cast_rays(sensors, p.max_range_m, walls, ranges)
        disturb(ranges, p.sigma_m, p.dropout_probability, p.min_range_m, self._noise)
        return ranges

    def scan(self, x_m: float, y_m: float, theta_rad: float) -> np.ndarray:
        """Measure the ranges from a pose of base in world.

        Returns
        -------
        ndarray
            (beams,) [m]; inf if nothing came back, or from nearer than the minimum range.
        """
        p = self.parameters
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        ranges = np.empty(p.beams)
        cast_fan(
            x_m + c * p.x_m - s * p.y_m,
            y_m + s * p.x_m + c * p.y_m,
            theta_rad + math.radians(p.heading_deg),
            self._angles,
            p.max_range_m,
            self.walls.at(x_m, y_m),
            ranges,
            self._hits,
        )
        disturb(ranges, p.sigma_m, p.dropout_probability, p.min_range_m, self._noise)
        return ranges


@compiled
@borrows
def disturb(
    ranges: np.ndarray, sigma: float, dropout: float, min_range: float, noise: np.ndarray
) -> None:
    """Add noise to a scan in place, and lose some of it."""
    for i in range(len(ranges)):
        if ranges[i] < min_range or (dropout > 0.0 and uniform(noise) < dropout):
            ranges[i] = np.inf
        elif sigma > 0.0 and ranges[i] < np.inf:
            ranges[i] = max(ranges[i] + sigma * normal(noise), min_range)
