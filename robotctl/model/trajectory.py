"""Poses over time: of a reference, an odometry or an estimate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.motion import between
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses of `base` in a fixed frame, in the order of their times.

    Parameters
    ----------
    stamps_ns
        Times, (n,) int64 [ns], not decreasing, n > 0.
    poses
        Poses, (n, 3): x [m], y [m], theta [rad].

    Raises
    ------
    ValueError
        If the shapes do not fit, a pose is not finite, or times decrease.
    """

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.stamps_ns)
        if n == 0 or self.stamps_ns.shape != (n,) or self.poses.shape != (n, 3):
            raise ValueError(
                f"stamps_ns must be (n,) and poses (n, 3), n > 0, found {self.stamps_ns.shape} "
                f"and {self.poses.shape}"
            )
        if not np.all(np.isfinite(self.poses)):
            raise ValueError("poses must be finite")
        if np.any(np.diff(self.stamps_ns) < 0):
            raise ValueError("stamps_ns must not decrease")

    @classmethod
    def of(cls, stamps_ns: Iterable[int], poses: Iterable[SE2]) -> Trajectory:
        """Return the trajectory through poses; raises as the constructor."""
        rows = [(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]
        return cls(np.array(list(stamps_ns), dtype=np.int64), np.array(rows).reshape(-1, 3))

    def at(self, stamp_ns: int) -> SE2 | None:
        """Return the pose at a time, interpolated; None outside of the trajectory."""
        if not self.stamps_ns[0] <= stamp_ns <= self.stamps_ns[-1]:
            return None
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        end_ns, end = int(self.stamps_ns[after]), SE2(*self.poses[after].tolist())
        if end_ns == stamp_ns:
            return SE2(end.x_m, end.y_m, wrap_angle(end.theta_rad))
        begin_ns, begin = int(self.stamps_ns[after - 1]), SE2(*self.poses[after - 1].tolist())
        return between(begin, end, (stamp_ns - begin_ns) / (end_ns - begin_ns))
