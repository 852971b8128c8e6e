"""Motion of particles by odometry with noise: e, f, g of `motion_noise.py` for many poses.

Odometry gives the motion in `base`; each particle makes it with its own noise. The noise has
exactly the covariance that `motion_noise.py` gives for the path, so it does not depend on how the
path is cut into steps, plus a small floor for motion that odometry misses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance
from robotctl.model.geometry.angles import sinc
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class ParticleMotionConfig:
    """Noise of the particles' motion.

    Parameters
    ----------
    noise
        Grows with distance and angle.
    floor_m, floor_rad
        Standard deviations that each motion adds to x and y [m] and to the heading [rad], > 0. They
        keep copies of one particle apart.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    noise: MotionNoise = field(default_factory=lambda: MotionNoise(0.15, 0.15, 0.15))
    floor_m: float = 0.01
    floor_rad: float = 0.005

    def __post_init__(self) -> None:
        for key in ("floor_m", "floor_rad"):
            if not 0.0 < getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {getattr(self, key)}")


class OdometrySegment:
    """The motion since the particles were last moved, with the covariance of its noise.

    Parameters
    ----------
    config
        Noise.
    """

    def __init__(self, config: ParticleMotionConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Start a new path."""
        self.motion = SE2()
        """Motion from the start of the path to its end, in `base` at the start."""
        self.distance_m = 0.0
        self.angle_rad = 0.0
        """Sum of the turns' amounts [rad]."""
        self.covariance = np.zeros((3, 3))
        """Covariance of the motion's noise, in `base` at the start, without the floor, (3, 3)."""

    def add(self, delta: SE2) -> None:
        """Add a motion in the present `base`.

        Between the two ends an arc is assumed; where the motion is none of a drive that rolls
        forward, it starts in the direction that makes it one.
        """
        chord = math.hypot(delta.x_m, delta.y_m)
        turned = delta.theta_rad
        if chord == 0.0 and turned == 0.0:
            return
        length = chord / sinc(0.5 * turned)
        heading = math.atan2(delta.y_m, delta.x_m) - 0.5 * turned
        start = SE2(self.motion.x_m, self.motion.y_m, self.motion.theta_rad + heading)
        before, self.motion = self.motion, self.motion @ delta
        F = np.eye(3)
        F[0, 2] = -(self.motion.y_m - before.y_m)
        F[1, 2] = self.motion.x_m - before.x_m
        added = added_covariance(start, length, turned, self._config.noise)
        self.covariance = F @ self.covariance @ F.T + added
        self.distance_m += length
        self.angle_rad += abs(turned)

    def end(self, pose: SE2, covariance: NDArray[np.float64]) -> tuple[SE2, NDArray[np.float64]]:
        """Return pose and covariance (3, 3) in `world` after the path, from those before it."""
        after = pose @ self.motion
        F = np.eye(3)
        F[0, 2] = -(after.y_m - pose.y_m)
        F[1, 2] = after.x_m - pose.x_m
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return after, F @ covariance @ F.T + R @ self.covariance @ R.T

    def moved(self, poses: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the poses at the end of the path, each with its own noise.

        Parameters
        ----------
        poses
            At the start of the path, (n, 3) [m, m, rad].
        rng
            Draws the noise.

        Returns
        -------
        NDArray
            (n, 3), headings in [-pi, pi].
        """
        floor_m, floor_rad = self._config.floor_m, self._config.floor_rad
        covariance = self.covariance + np.diag([floor_m**2, floor_m**2, floor_rad**2])
        noise = rng.standard_normal(poses.shape)
        motion = np.array([self.motion.x_m, self.motion.y_m, self.motion.theta_rad])
        result = np.empty_like(poses)
        _move(poses, motion, covariance, noise, result)
        return result


@compiled
def _move(
    poses: NDArray[np.float64],
    motion: NDArray[np.float64],
    covariance: NDArray[np.float64],
    noise: NDArray[np.float64],
    result: NDArray[np.float64],
) -> None:
    """Fill `result` with pose @ (motion + root noise), root root^T = covariance (Cholesky)."""
    turn = 2.0 * math.pi
    xx = math.sqrt(covariance[0, 0])
    yx, tx = covariance[1, 0] / xx, covariance[2, 0] / xx
    yy = math.sqrt(covariance[1, 1] - yx * yx)
    ty = (covariance[2, 1] - tx * yx) / yy
    tt = math.sqrt(covariance[2, 2] - tx * tx - ty * ty)
    for i in range(len(poses)):
        a, b, c = noise[i, 0], noise[i, 1], noise[i, 2]
        dx = motion[0] + xx * a
        dy = motion[1] + yx * a + yy * b
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        result[i, 0] = poses[i, 0] + cos * dx - sin * dy
        result[i, 1] = poses[i, 1] + sin * dx + cos * dy
        theta = poses[i, 2] + motion[2] + tx * a + ty * b + tt * c
        result[i, 2] = theta - turn * np.rint(theta / turn)
