"""Sonar signature from readings during a turn on the spot, placed by odometry."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.signatures import Signature, SignatureConfig, signature_of
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading
from robotctl.model.sensors.sonar_mounts import mount_rows

_MOST_READINGS: Final = 2000
"""Readings kept: 50 s of sonars that fire 40 times a second."""


@dataclass(frozen=True, slots=True)
class TurnConfig:
    """Criteria of one turn on the spot.

    Parameters
    ----------
    spot_m
        `base` stays within this of where it ends [m], > 0.
    round_rad
        How far it turns [rad], > 0.

    Raises
    ------
    ValueError
        If a value is not > 0.
    """

    spot_m: float = 0.1
    round_rad: float = math.tau

    def __post_init__(self) -> None:
        for key in self.__slots__:
            if not 0.0 < getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {getattr(self, key)}")


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A finished turn.

    Parameters
    ----------
    stamp_ns
        Time of its last reading [ns].
    began, odometry
        `base` at its first and at its last reading, in the frame of the odometry.
    signature
        Signature around `base` at the last reading.
    """

    stamp_ns: int
    began: SE2
    odometry: SE2
    signature: Signature


class TurnCollector:
    """Collects sonar readings; reports when a turn on the spot is complete.

    A robot that drives never completes one. Each turn begins where the one before has ended.

    Parameters
    ----------
    mounts
        Mounting of the sonars, in the order of the ranges.
    config
        Settings of the signatures.
    turn
        Criteria of a turn.
    """

    def __init__(
        self,
        mounts: Sequence[SonarMount],
        config: SignatureConfig,
        turn: TurnConfig | None = None,
    ) -> None:
        self._config = config
        self._turn = turn or TurnConfig()
        self._mounts = mount_rows(mounts)
        self.reset()

    def reset(self) -> None:
        """Forget the readings."""
        self._heard: deque[tuple[SE2, float, tuple[float, ...]]] = deque(maxlen=_MOST_READINGS)
        """Odometry, its heading without jumps [rad], and ranges."""

    @property
    def turned_rad(self) -> float:
        """Angle turned on the present spot [rad], >= 0."""
        headings = [heading for _, heading, _ in self._heard]
        return max(headings) - min(headings) if headings else 0.0

    def add(self, reading: SonarReading, odometry: SE2) -> Turn | None:
        """Add a reading and the odometry's pose at its time; return the turn that it completes.

        Raises
        ------
        ValueError
            If the reading has not one range for each sonar.
        """
        if len(reading.ranges_m) != len(self._mounts):
            raise ValueError(
                f"ranges_m must have one range for each of {len(self._mounts)} sonars, found "
                f"{len(reading.ranges_m)}"
            )
        heading = odometry.theta_rad
        if self._heard:
            last = self._heard[-1][1]
            heading = last + wrap_angle(heading - last)
        self._heard.append((odometry, heading, reading.ranges_m))
        while self._distance_m(self._heard[0][0], odometry) > self._turn.spot_m:
            self._heard.popleft()
        if self.turned_rad < self._turn.round_rad:
            return None
        turn = Turn(reading.stamp_ns, self._heard[0][0], odometry, self._signature(odometry))
        self.reset()
        return turn

    @staticmethod
    def _distance_m(a: SE2, b: SE2) -> float:
        return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)

    def _signature(self, end: SE2) -> Signature:
        """Return the readings, seen from `base` at the end of the turn."""
        rows = [(end.inverse() @ pose, ranges) for pose, _, ranges in self._heard]
        poses = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose, _ in rows])
        ranges = np.array([each for _, each in rows])
        bearings, depths = around_base(poses, self._mounts, ranges, self._config.max_range_m)
        return signature_of(bearings.ravel(), depths.ravel(), self._config)


def around_base(
    poses: NDArray[np.float64],
    mounts: NDArray[np.float64],
    ranges_m: NDArray[np.float64],
    max_range_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return readings as bearings and depths around the origin, (n, s) [rad] and (n, s) [m].

    Parameters
    ----------
    poses
        Poses of `base`, (n, 3) [m, m, rad].
    mounts
        x, y, heading of each sonar in `base`, (s, 3) [m, m, rad].
    ranges_m
        (n, s) [m]: an echo counts on the sonar's axis; inf without one, whose bearing is that of
        the axis at `max_range_m`; nan, without a reading, gives a depth of nan.
    max_range_m
        Maximum range of the sonars [m].
    """
    reach = np.where(ranges_m < max_range_m, ranges_m, max_range_m)
    x = mounts[:, 0] + reach * np.cos(mounts[:, 2])
    y = mounts[:, 1] + reach * np.sin(mounts[:, 2])
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    px, py = poses[:, :1] + cos * x - sin * y, poses[:, 1:2] + sin * x + cos * y
    depths = np.where(ranges_m < max_range_m, np.hypot(px, py), np.inf)
    return np.arctan2(py, px), np.where(np.isnan(ranges_m), np.nan, depths)
