"""A lidar as the robot sees it: a port that gives one revolution after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class LidarSweep:
    """One revolution, in the order in which it was measured.

    Parameters
    ----------
    stamps_ns
        When each sample was taken, (n,) int64 [ns], monotonic, never falling; n > 0.
    angles_rad
        Its direction from the lidar's zero, counter-clockwise seen from its head, (n,) [rad].
    ranges_m
        (n,) [m]; nan: nothing was measured, whether there was no echo or no valid one.
    """

    stamps_ns: NDArray[np.int64]
    angles_rad: NDArray[np.float64]
    ranges_m: NDArray[np.float64]


class LidarPort(Protocol):
    """A lidar. Older revolutions than the newest are dropped."""

    def read(self) -> LidarSweep | None:
        """Wait for data for a short time; return a revolution that is complete now, else None.

        Raises
        ------
        LinkError
            If the lidar is gone, or silent.
        """

    def close(self) -> None:
        """Stop the lidar and release it."""
