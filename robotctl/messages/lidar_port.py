"""Port of the lidar, which returns one revolution after the other."""

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
        Time of each sample, (n,) int64 [ns], monotonic, never decreasing; n > 0.
    angles_rad
        Directions from the lidar's zero, counter-clockwise seen from its head, (n,) [rad].
    ranges_m
        Ranges, (n,) [m]; nan: no valid echo.
    """

    stamps_ns: NDArray[np.int64]
    angles_rad: NDArray[np.float64]
    ranges_m: NDArray[np.float64]


class LidarPort(Protocol):
    """A lidar. Only the newest revolution is kept."""

    def read(self) -> LidarSweep | None:
        """Wait briefly for data; return a revolution if complete, else None.

        Raises
        ------
        LinkError
            If the lidar is lost or silent.
        """

    def close(self) -> None:
        """Stop the lidar and release it."""
