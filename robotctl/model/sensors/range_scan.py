"""A scan of a planar range sensor: a lidar, or the floor's boundary in a camera's picture.

From the driver to the planner a scan of a lidar has three forms, each for a reason:
`messages.lidar_port.LidarSweep`, a revolution as it was measured, each sample with its own time, by
which the motion of the robot is taken out; `messages.estimation.LidarScan`, the same as from one
place, in even steps, as bytes for sockets and logs; and this, with any directions, for all that
computes with it.

Scans of several lidars are kept apart, each with its own mount and time, by all that takes them one
after the other. Where one view is needed, to match it with another, the later one carries those of
the `others`, moved to its time: each beam still begins where it did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class RangeScan:
    """Ranges of many beams from one point of the robot.

    Parameters
    ----------
    stamp_ns
        Time of the scan, of the beam measured last [ns], monotonic, or of the log's own clock.
    angles_rad
        Directions of the beams in `base`, counter-clockwise from forward, (n,) [rad].
    ranges_m
        Ranges, (n,) [m]; inf: nothing within `max_range_m`; nan: no valid reading.
    max_range_m
        Maximum range [m], > 0.
    x_m, y_m
        Position of the sensor in `base` [m].
    sigmas_m
        Standard deviation of each range, (n,) [m], >= 0, nan if there is no reading; None: not
        known.
    name
        Name of the sensor among several of its kind; empty: the only one.
    sweep_s
        Time from the first beam to the last [s]; negative: the last was measured first; 0: all at
        one instant. `unwinding.unwound` takes the robot's motion out.
    others
        Scans of other sensors at the same instant, in the same `base`.

    Raises
    ------
    ValueError
        If the arrays are not all (n,), or a number is out of its range.
    """

    stamp_ns: int
    angles_rad: NDArray[np.float64]
    ranges_m: NDArray[np.float64]
    max_range_m: float
    x_m: float = 0.0
    y_m: float = 0.0
    sigmas_m: NDArray[np.float64] | None = None
    name: str = ""
    sweep_s: float = 0.0
    others: tuple[RangeScan, ...] = ()

    def __post_init__(self) -> None:
        if self.angles_rad.ndim != 1 or self.angles_rad.shape != self.ranges_m.shape:
            raise ValueError(
                f"angles_rad {self.angles_rad.shape} and ranges_m {self.ranges_m.shape} must both "
                "be (n,)"
            )
        if not np.all(np.isfinite(self.angles_rad)):
            raise ValueError("angles_rad must be finite")
        if np.any(self.ranges_m < 0.0):
            raise ValueError("ranges_m must not be negative")
        if not 0.0 < self.max_range_m < math.inf:
            raise ValueError(f"max_range_m must be finite and > 0, found {self.max_range_m}")
        if not (math.isfinite(self.x_m) and math.isfinite(self.y_m)):
            raise ValueError("x_m and y_m must be finite")
        if not math.isfinite(self.sweep_s):
            raise ValueError(f"sweep_s must be finite, found {self.sweep_s}")
        if self.sigmas_m is not None:
            self._check_sigmas(self.sigmas_m)

    def _check_sigmas(self, sigmas_m: NDArray[np.float64]) -> None:
        if sigmas_m.shape != self.ranges_m.shape:
            raise ValueError(
                f"sigmas_m {sigmas_m.shape} must be of the shape of ranges_m {self.ranges_m.shape}"
            )
        measured = sigmas_m[np.isfinite(self.ranges_m)]
        if not np.all(np.isfinite(measured)) or np.any(sigmas_m < 0.0):
            raise ValueError(
                "sigmas_m must not be negative, and must be finite where there is a range"
            )

    @property
    def echoes(self) -> NDArray[np.bool_]:
        """Beams that hit something within the maximum range, (n,); nan is no valid reading."""
        hit: NDArray[np.bool_] = self.ranges_m < self.max_range_m
        return hit

    @property
    def parts(self) -> tuple[RangeScan, ...]:
        """The scan itself, and those of the others."""
        return (self, *self.others)

    def points_base(self) -> NDArray[np.float64]:
        """Return the end points of the beams that hit something, in `base`, (k, 2) [m].

        With those of the others.
        """
        return np.concatenate([each._own_points() for each in self.parts])

    def _own_points(self) -> NDArray[np.float64]:
        angles, ranges = self.angles_rad[self.echoes], self.ranges_m[self.echoes]
        return np.stack(
            [self.x_m + ranges * np.cos(angles), self.y_m + ranges * np.sin(angles)], axis=1
        )

    def moved(self, T_a_base: SE2) -> RangeScan:
        """Return the scan, and those of the others, as of a `base` at a."""
        sensor = T_a_base @ SE2(self.x_m, self.y_m)
        return replace(
            self,
            angles_rad=self.angles_rad + T_a_base.theta_rad,
            x_m=sensor.x_m,
            y_m=sensor.y_m,
            others=tuple(each.moved(T_a_base) for each in self.others),
        )
