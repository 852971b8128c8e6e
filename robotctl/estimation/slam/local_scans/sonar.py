"""Local scans of a sonar ring.

A sonar tells how far something is, not where in its cone: it hears where the wall is nearest,
square to it at a distance d, or on an edge of the cone at d / cos(incidence). While the robot
moves, d to one piece of wall changes with the place as the wall's direction says: d_j = d_i - n
(p_j - p_i), with n square to the wall. So neighbouring readings determine n, and what few of them
confirm, an echo of another sonar or of a person, is left out. A corner or a post fits as well: over
so short a distance it looks like a wall square to the sound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.local_scans.gathered import GatheredScans
from robotctl.estimation.slam.local_scans.source import UNKNOWN_WHEELS, ScanSource
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan
from robotctl.model.sensors.sonar import SonarMount, SonarReading
from robotctl.model.sensors.sonar_mounts import mount_rows

STRETCH_M: Final = 2.0
_NEAR_M: Final = 0.2
"""Distance before and after a reading within which others confirm it [m]."""
_STEP_M: Final = 0.01
_STEP_RAD: Final = 0.015
"""Spacing of readings along the way [m], and of the wall directions tried [rad]."""
_FITS_M: Final = 0.03
_LEAST: Final = 4
_SHARE: Final = 0.65
_VAGUE_M: Final = 0.2
"""Maximum length of the arc on which an echo may lie [m]."""
_NOISE_M: Final = 0.01


def echo_direction(
    own: NDArray[np.float64],
    near: NDArray[np.float64],
    half_beam_rad: float,
    max_incidence_rad: float,
) -> float | None:
    """Return the direction in which a reading's echo came back, by readings around it.

    Parameters
    ----------
    own, near
        The reading, (4,), and those of the same sonar around it with itself, (n, 4): x, y and
        direction of the sonar in `odom` [m, m, rad], range [m].
    half_beam_rad
        Half opening of the cone [rad].
    max_incidence_rad
        Greatest angle between sound and a wall's normal that gives an echo [rad].

    Returns
    -------
    In `odom` [rad]; None if too few readings agree, or it stays open.
    """
    open_rad = half_beam_rad + max_incidence_rad
    offs = np.linspace(-open_rad, open_rad, 2 * round(open_rad / _STEP_RAD) + 1)
    normals = own[2] + offs
    edges = np.clip(offs, -half_beam_rad, half_beam_rad)
    square_m = own[3] * np.cos(offs - edges)
    dx, dy = near[:, 0] - own[0], near[:, 1] - own[1]
    there_m = square_m[:, None] - np.cos(normals)[:, None] * dx - np.sin(normals)[:, None] * dy
    off = np.angle(np.exp(1j * (normals[:, None] - near[:, 2])))
    incidences = np.clip(np.abs(off) - half_beam_rad, 0.0, max_incidence_rad + _STEP_RAD)
    residuals = near[:, 3] - there_m / np.cos(incidences)
    fits = (np.abs(residuals) < _FITS_M) & (incidences < max_incidence_rad + _STEP_RAD)
    counts = fits.sum(axis=1)
    most = int(counts.max())
    if most < max(_LEAST, _SHARE * len(near)):
        return None
    squares = np.where(fits, residuals**2, 0.0).sum(axis=1) + _FITS_M**2 * (most - counts)
    # Chi-squared: within 4 of the minimum is as good.
    good = edges[squares <= squares.min() + 4.0 * _NOISE_M**2]
    if (good.max() - good.min()) * own[3] > _VAGUE_M:
        return None
    return float(own[2] + 0.5 * (good.max() + good.min()))


class SonarScans:
    """Makes local scans of the readings of a ring.

    Parameters
    ----------
    mounts
        The sonars, in the order of the ranges.
    config
        Cone and range of the sonars.

    Raises
    ------
    ValueError
        If there are no sonars.
    """

    def __init__(self, mounts: Sequence[SonarMount], config: SonarModelConfig) -> None:
        if not mounts:
            raise ValueError("no sonars are mounted")
        self._mounts = mount_rows(mounts)
        self._half_beam_rad = math.radians(0.5 * config.beam_deg)
        self._max_incidence_rad = math.radians(config.max_incidence_deg)
        self._max_range_m = config.max_range_m
        self._gathered = GatheredScans(STRETCH_M, config.max_range_m)
        self._rows: list[list[tuple[float, NDArray[np.float64]]]] = [[] for _ in mounts]
        """Last readings of each sonar: distance travelled; x, y, direction, range."""
        self._next = [0] * len(mounts)
        """The first of those whose echo has not been placed yet."""

    def add(self, reading: SonarReading, odometry: SE2) -> list[RecordedScan]:
        """Take a reading in the order of time, with `base` in `odom` then; return new scans."""
        gathered = self._gathered
        gathered.move(reading.stamp_ns, odometry)
        for sonar, range_m in enumerate(reading.ranges_m):
            if range_m < self._max_range_m:
                self._hear(sonar, odometry, range_m)
            for way_m, point in self._placed(sonar):
                gathered.see(way_m, point)
        return gathered.take(gathered.way_m - _NEAR_M)

    def _hear(self, sonar: int, odometry: SE2, range_m: float) -> None:
        """Keep a reading, if the sonar stands elsewhere than at the last one."""
        pose, rows = odometry @ SE2(*self._mounts[sonar].tolist()), self._rows[sonar]
        way_m = self._gathered.way_m
        if not rows or way_m - rows[-1][0] >= _STEP_M:
            rows.append((way_m, np.array([pose.x_m, pose.y_m, pose.theta_rad, range_m])))

    def _placed(self, sonar: int) -> list[tuple[float, NDArray[np.float64]]]:
        """Return the echoes that can be placed by now; forget what is not needed any more."""
        rows, result = self._rows[sonar], []
        while self._next[sonar] < len(rows):
            way_m, own = rows[self._next[sonar]]
            if way_m > self._gathered.way_m - _NEAR_M:
                break
            self._next[sonar] += 1
            near = [row for place_m, row in rows if abs(place_m - way_m) <= _NEAR_M]
            direction = echo_direction(
                own, np.array(near), self._half_beam_rad, self._max_incidence_rad
            )
            if direction is not None:
                along = np.array([[math.cos(direction), math.sin(direction)]])
                result.append((way_m, own[:2] + own[3] * along))
        old = 0
        while old < self._next[sonar] and rows[old][0] < self._gathered.way_m - 3.0 * _NEAR_M:
            old += 1
        del rows[:old]
        self._next[sonar] -= old
        return result


def _maker(robot: SensedRobot) -> SonarScans:
    return SonarScans(robot.mounts, robot.settings.sonar)


SOURCE: Final = ScanSource(
    KeyframeConfig(keyframe_m=0.5, keyframe_rad=0.5, stretch_m=STRETCH_M, wheels=UNKNOWN_WHEELS),
    _maker,
    lambda recording: [(each.reading, each.odometry) for each in recording.sonars],
)
