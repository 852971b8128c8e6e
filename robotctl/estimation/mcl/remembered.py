"""The last measurements and the motion since each: their joint evidence on the present pose.

The motion is that of odometry, without noise: good for some metres, and for comparing places.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.log_likelihood import LogLikelihood, evaluated
from robotctl.model.geometry.se2 import SE2

_MOST: Final = 16
"""Measurements that are kept: older ones suffer from the drift of the odometry, and each takes as
much time as a measurement."""


class Remembered:
    """The last measurements, at most 16."""

    def __init__(self) -> None:
        self._all: deque[tuple[LogLikelihood, SE2]] = deque(maxlen=_MOST)
        """Each with the pose of `base` at its time in the present `base`."""

    def __len__(self) -> int:
        return len(self._all)

    def clear(self) -> None:
        """Forget all."""
        self._all.clear()

    def move(self, motion: SE2) -> None:
        """Take in a motion of `base`, in `base` before it."""
        back = motion.inverse()
        moved = [(measurement, back @ then) for measurement, then in self._all]
        self._all.clear()
        self._all.extend(moved)

    def add(self, measurement: LogLikelihood) -> None:
        """Take in a measurement, made now."""
        self._all.append((measurement, SE2()))

    @property
    def newest(self) -> LogLikelihood:
        """The last measurement."""
        return self._all[-1][0]

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sum of all log-likelihoods at each pose (n, 3) of now, (n,)."""
        total = np.zeros(len(poses))
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        for measurement, then in self._all:
            x = poses[:, 0] + c * then.x_m - s * then.y_m
            y = poses[:, 1] + s * then.x_m + c * then.y_m
            theta = poses[:, 2] + then.theta_rad
            theta -= math.tau * np.round(theta / math.tau)
            total += evaluated(measurement, np.stack([x, y, theta], axis=1))
        return total
