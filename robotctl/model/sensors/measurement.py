"""Proprioceptive and exteroceptive measurements (Siegwart et al., section 4.1).

A proprioceptive measurement depends on the robot's own states alone, z = z(x_i, x_i-1); an
exteroceptive one on its state and on the world, z = z(x, y). Each has its time, frame and
uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class MotionMeasurement:
    """Proprioceptive: motion of the robot by its wheels.

    Parameters
    ----------
    begin_ns, stamp_ns
        Begin and end of the motion [ns].
    motion
        Pose of `base` at the end in `base` at the beginning.
    covariance
        Covariance of (x, y, theta) of the motion, in `base` at the beginning, (3, 3) [m, m, rad].

    Raises
    ------
    ValueError
        If it ends before it begins, or the covariance is not (3, 3).
    """

    begin_ns: int
    stamp_ns: int
    motion: SE2
    covariance: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.stamp_ns < self.begin_ns:
            raise ValueError(f"stamp_ns {self.stamp_ns} is before begin_ns {self.begin_ns}")
        if self.covariance.shape != (3, 3):
            raise ValueError(f"covariance must be (3, 3), found {self.covariance.shape}")


@dataclass(frozen=True, slots=True, eq=False)
class RangeMeasurement:
    """Exteroceptive: ranges along some beams, all at one instant.

    Parameters
    ----------
    stamp_ns
        Time [ns].
    beams
        Origin and direction of each beam in `base`, (k, 3) [m, m, rad].
    ranges_m
        Ranges, (k,) [m]; inf: nothing within `max_range_m`; nan: no measurement.
    sigmas_m
        Standard deviation of each range, (k,) [m]; errors are independent, so that the covariance
        is diagonal.
    max_range_m
        Maximum range [m]; None: not known.

    Raises
    ------
    ValueError
        If the shapes do not fit.
    """

    stamp_ns: int
    beams: NDArray[np.float64]
    ranges_m: NDArray[np.float64]
    sigmas_m: NDArray[np.float64]
    max_range_m: float | None = None

    def __post_init__(self) -> None:
        k = len(self.ranges_m)
        if self.beams.shape != (k, 3) or self.sigmas_m.shape != (k,):
            raise ValueError(
                f"beams {self.beams.shape} must be (k, 3), ranges_m {self.ranges_m.shape} and "
                f"sigmas_m {self.sigmas_m.shape} (k,)"
            )
