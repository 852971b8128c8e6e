"""Calibrated parameters of a drive, and the resulting motion.

Each drive names the few numbers that decide its odometry (`Drive.calibrated`). They are taken as
changes of the nominal drive, 0 where it is right: an angle [rad] by its difference, all else by the
logarithm of its factor. What is found is what acts: a steering that turns by a constant factor too
far looks like a shorter wheelbase, and wheels that slip in a turn like a wider track.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.drives import Drive

Array: TypeAlias = NDArray[np.float64]

REACH = 0.3
"""Changes are searched up to this size: a factor of 1.35, or 0.3 rad of an angle."""


@dataclass(frozen=True, slots=True)
class OdometryModel:
    """The calibration of one drive.

    Parameters
    ----------
    nominal
        The drive of the robot's file.
    """

    nominal: Drive

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of `[drive]` that calibration sets, in the order of the changes."""
        return tuple(self.nominal.calibrated)

    @property
    def size(self) -> int:
        """Number of the changes."""
        return len(self.nominal.calibrated)

    @property
    def nothing(self) -> Array:
        """No change, (size,)."""
        return np.zeros(self.size)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest change of the search, (size,) each."""
        ends = []
        for key, values in self.nominal.calibrated.items():
            present = getattr(self.nominal, key)
            ends.append([_change(key, present, value) for value in values])
        low, high = np.array(ends).T
        return np.maximum(low, -REACH), np.minimum(high, REACH)

    def drive(self, change: Array) -> Drive:
        """Return the drive changed by `change`, (size,)."""
        values = {}
        for key, step in zip(self.keys, change.tolist(), strict=True):
            present = getattr(self.nominal, key)
            values[key] = present + step if key.endswith("_rad") else present * math.exp(step)
        return dataclasses.replace(self.nominal, **values)

    def moves(self, change: Array, rolled: Array) -> Array:
        """Return the moves of the changed drive, (n, 3): way, turn, and way sideways [m, rad, m].

        Parameters
        ----------
        change
            Of the drive, (size,).
        rolled
            (n, wheels + joints): turns of the wheels [rad], angles of the joints meanwhile [rad].
        """
        return self.drive(change).forward_many(rolled)

    def travel_m(self, rolled: Array) -> Array:
        """Return how far the rims of the driven wheels travelled in the mean, (n,) [m]."""
        radii_m = np.array(self.nominal.wheel_radii_m)
        return np.asarray(np.mean(np.abs(rolled[:, : len(radii_m)]) * radii_m, axis=1))

    def rolled(self, moves: Array) -> Array:
        """Return what wheels and joints do where the nominal odometry moves by `moves`.

        The inverse of `moves` for no change, so a log of odometry poses is as good as one of
        wheels, if it was made with the nominal drive.
        """
        return self.nominal.inverse_many(moves)


def _change(key: str, present: float, value: float) -> float:
    """Return the change that leads from the present value of a key to another one."""
    if key.endswith("_rad"):
        return value - present
    return math.log(value / present) if value > 0.0 else -math.inf
