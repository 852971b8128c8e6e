"""A pose from a few sightings of known landmarks, without any idea of where the robot is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

_APART_M = 1.0
"""Minimum distance between landmarks that determine a heading."""
_SIGMA_M = 0.2
"""Standard deviation of one sighting, moving and with a camera not yet calibrated [m]."""


class SeenLandmark:
    """A landmark in `base` as it moved away since it was seen.

    Parameters
    ----------
    stamp_ns
        When it was seen [ns].
    landmark_world
        Where it is [m].
    range_m, bearing_rad
        Where it was seen from `base` [m], [rad].
    """

    def __init__(
        self,
        stamp_ns: int,
        landmark_world: tuple[float, float],
        range_m: float,
        bearing_rad: float,
    ) -> None:
        self.stamp_ns = stamp_ns
        self.landmark_world = landmark_world
        self.landmark_base = (
            range_m * math.cos(bearing_rad),
            range_m * math.sin(bearing_rad),
        )

    def move(self, T_after_before: SE2) -> None:
        """Take in a motion of `base`."""
        self.landmark_base = T_after_before.apply(*self.landmark_base)


def pose_from_landmarks(seen: Iterable[SeenLandmark]) -> tuple[SE2, Array] | None:
    """Return the pose that fits best, and its covariance (3, 3); None if too little was seen.

    Least squares in closed form: Arun, Huang, Blostein: Least-squares fitting of two 3-D point
    sets, IEEE PAMI 9(5), 1987, for the plane. What fits worst is left out as long as something
    does not fit and more than half is left.
    """
    sightings = list(seen)
    world = np.array([each.landmark_world for each in sightings]).reshape(-1, 2)
    base = np.array([each.landmark_base for each in sightings]).reshape(-1, 2)
    # At most half of the sightings may be dropped: the rest would be no majority.
    least = len(sightings) // 2
    while len(world) > least and float(np.ptp(world, axis=0).sum()) >= _APART_M:
        pose, off_m = _fit(world, base)
        worst = int(np.argmax(off_m))
        if off_m[worst] <= 3.0 * _SIGMA_M:
            return pose, _covariance(pose, world)
        world, base = np.delete(world, worst, axis=0), np.delete(base, worst, axis=0)
    return None


def _fit(world: Array, base: Array) -> tuple[SE2, Array]:
    """Return the pose that brings points of `base` (n, 2) to those of `world`, and how far off."""
    middle_world, middle_base = world.mean(axis=0), base.mean(axis=0)
    w, b = world - middle_world, base - middle_base
    theta = math.atan2(float(np.sum(b[:, 0] * w[:, 1] - b[:, 1] * w[:, 0])), float(np.sum(b * w)))
    R = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
    x, y = (middle_world - R @ middle_base).tolist()
    off = w - b @ R.T
    return SE2(x, y, theta), np.hypot(off[:, 0], off[:, 1])


def _covariance(pose: SE2, world: Array) -> Array:
    """Return the covariance if all points together say no more than two would alone."""
    information: Array = np.zeros((3, 3))
    for ax, ay in (world - (pose.x_m, pose.y_m)).tolist():
        J = np.array([[1.0, 0.0, -ay], [0.0, 1.0, ax]])
        information += J.T @ J
    return np.asarray(np.linalg.inv(information) * (_SIGMA_M**2 * len(world) / 2.0), np.float64)
