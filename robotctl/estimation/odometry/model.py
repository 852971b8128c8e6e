"""Calibrated parameters of a drive, and the resulting arcs.

Three numbers of each drive decide its odometry. They are taken as changes of the nominal drive, 0
where it is right:

- differential: mean wheel radius (logarithm of the factor), radius of the right wheel over that of
  the left (the same), track width (the same);
- drive-and-steer: radius of the driven wheel and wheelbase (logarithms of the factors), offset of
  the steering [rad]. A steering that turns by a constant factor too far looks like a shorter
  wheelbase, so the wheelbase found is the one that acts.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive, TricycleDrive

Drive: TypeAlias = DifferentialDrive | TricycleDrive | AckermannDrive
"""Drives that can be calibrated."""

Array: TypeAlias = NDArray[np.float64]

REACH = 0.3
"""Changes are searched up to this size: a factor of 1.35, or 0.3 rad of the steering."""


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
        if isinstance(self.nominal, DifferentialDrive):
            return "wheel_radius_m", "wheel_radius_ratio", "track_width_m"
        return "wheel_radius_m", "wheelbase_m", "steering_offset_rad"

    @property
    def reach(self) -> Array:
        """Largest change in the search, (3,)."""
        if isinstance(self.nominal, DifferentialDrive):
            return np.full(3, REACH)
        most_rad = self.nominal.steering_max_rad
        room_rad = min(most_rad, 0.5 * math.pi - most_rad) - abs(self.nominal.steering_offset_rad)
        return np.array([REACH, REACH, min(REACH, 0.9 * room_rad)])

    def drive(self, change: Array) -> Drive:
        """Return the drive changed by `change`, (3,)."""
        values = {}
        for key, step in zip(self.keys, change.tolist(), strict=True):
            present = getattr(self.nominal, key)
            values[key] = present + step if key.endswith("_rad") else present * math.exp(step)
        return dataclasses.replace(self.nominal, **values)

    def arcs(self, change: Array, wheels: Array) -> Array:
        """Return length [m] and turn [rad] of the changed drive for turns of the wheels, (n, 2).

        Parameters
        ----------
        change
            Of the drive, (3,).
        wheels
            (n, 3): turn of wheel 1 and of wheel 2 [rad], angle of the steering meanwhile [rad].
        """
        return arcs_of(self.drive(change), wheels)

    def travel_m(self, wheels: Array) -> Array:
        """Return how far the rims of the driven wheels travelled in the mean, (n,) [m]."""
        radii_m = np.array(self.nominal.wheel_radii_m)
        return np.asarray(np.mean(np.abs(wheels[:, : len(radii_m)]) * radii_m, axis=1))

    def wheels(self, arcs: Array) -> Array:
        """Return the turns of the wheels for which the nominal odometry moves by `arcs`, (n, 3).

        The inverse of `arcs` for no change, so a log of odometry poses is as good as one of
        wheels, if it was made with the nominal drive.
        """
        d, alpha = arcs.T
        drive = self.nominal
        if isinstance(drive, DifferentialDrive):
            left_m, right_m = drive.wheel_radii_m
            half = 0.5 * drive.track_width_m * alpha
            return np.stack([(d - half) / left_m, (d + half) / right_m, np.zeros_like(d)], axis=1)
        across = drive.wheelbase_m * alpha
        # backwards, wheel and turn change their signs, and the steering stands as it did
        steering = np.arctan2(across * np.sign(d), np.abs(d))
        rolled = d / np.cos(steering) if _front_driven(drive) else d
        return np.stack(
            [
                rolled / drive.wheel_radius_m,
                np.zeros_like(d),
                np.where(d == 0.0, 0.0, steering - drive.steering_offset_rad),
            ],
            axis=1,
        )


def arcs_of(drive: Drive, wheels: Array) -> Array:
    """Return `drive.forward` of many rows (turn 1, turn 2, steering) at once, (n, 2)."""
    first, second, steering = wheels.T
    if isinstance(drive, DifferentialDrive):
        left_m, right_m = drive.wheel_radii_m
        left, right = left_m * first, right_m * second
        return np.stack([0.5 * (left + right), (right - left) / drive.track_width_m], axis=1)
    rolled, s = drive.wheel_radius_m * first, steering + drive.steering_offset_rad
    if _front_driven(drive):
        return np.stack([rolled * np.cos(s), rolled * np.sin(s) / drive.wheelbase_m], axis=1)
    return np.stack([rolled, rolled * np.tan(s) / drive.wheelbase_m], axis=1)


def _front_driven(drive: Drive) -> bool:
    return isinstance(drive, TricycleDrive) and drive.driven == "front"
