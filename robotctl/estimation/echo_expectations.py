"""What range sensors should have measured at known poses, and how squarely the sound or light met.

Sonars and lidar alike: a beam of a lidar is a sonar with a cone that is hardly open. How far each
should measure is `wall_echoes.py` or `grid_echoes.py`. The incidence of a reading is the least
angle to a surface's normal in its cone: below the sensor's limit there is an echo, and where there
is none, the limit is lower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.grid_echoes import GridEchoes
from robotctl.estimation.wall_echoes import WallEchoes
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

_OPEN_RAD: Final = math.radians(89.5)
_COARSE: Final = 45
_FINE: Final = 20
_TURN_RAD: Final = math.radians(1.0)
_BEAM: Final = 0.1
_END_M: Final = 0.15
"""So small a turn, share of the cone and piece of a wall should not change a reading."""
_SAME_M: Final = 1e-6
_CHANGE_M: Final = 0.03
_CHANGE: Final = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Sightlines:
    """Which sensor measured where.

    Parameters
    ----------
    poses
        Of `base` in `world`, (m, 3) [m, m, rad].
    sensors
        Number of the sensor, (m,).
    """

    poses: NDArray[np.float64]
    sensors: NDArray[np.intp]

    def some(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Sightlines:
        """Return some of them."""
        return Sightlines(self.poses[chosen], self.sensors[chosen])


class EchoExpectations:
    """Expected ranges of the sensors of a robot in a known room.

    Parameters
    ----------
    room
        Walls, or an occupancy grid.
    mounts
        The sensors in `base`, (k, 3): x, y, direction of the axis [m, m, rad].
    beam_rad
        Opening of their cones, from edge to edge, in (0, pi) [rad].
    reach_m
        Obstacles farther away are not looked at; farther than any sensor measures [m].
    """

    def __init__(
        self,
        room: WallMap | GridMap,
        mounts: NDArray[np.float64],
        beam_rad: float,
        reach_m: float,
    ) -> None:
        def echoes(room: WallMap | GridMap, share: float = 1.0) -> WallEchoes | GridEchoes:
            at = (mounts, share * beam_rad, _OPEN_RAD, reach_m)
            return WallEchoes(room, *at) if isinstance(room, WallMap) else GridEchoes(room, *at)

        self._echoes = echoes(room)
        self._others = [echoes(room, 1.0 - _BEAM), echoes(room, 1.0 + _BEAM)]
        self._endless = echoes(_without_ends(room)) if isinstance(room, WallMap) else None
        self._turned = [(0.0, 0.0, _TURN_RAD), (0.0, 0.0, -_TURN_RAD)]

    def ranges(
        self, lines: Sightlines, max_incidence_rad: float = _OPEN_RAD
    ) -> NDArray[np.float64]:
        """Return how far each should measure, (m,) [m]; inf where nothing sends an echo."""
        return _along(self._echoes.with_limit(max_incidence_rad), lines)

    def incidences(self, lines: Sightlines) -> NDArray[np.float64]:
        """Return the least incidence at which each meets a surface, (m,) [rad]; inf: none.

        To 0.1 degrees.
        """
        found = np.full(len(lines.sensors), math.inf)
        step = _OPEN_RAD / _COARSE
        begin = np.zeros(len(found))
        for i in range(1, _COARSE + 1):
            open_still = np.flatnonzero(np.isinf(found))
            heard = np.isfinite(self.ranges(lines.some(open_still), i * step))
            found[open_still[heard]] = i * step
            begin[open_still[heard]] = (i - 1) * step
        for i in range(1, _COARSE + 1):
            cell = np.flatnonzero(found == i * step)
            for j in range(_FINE - 1, 0, -1):
                limit = begin[cell[0]] + j * step / _FINE if len(cell) else 0.0
                if len(cell) == 0:
                    break
                heard = np.isfinite(self.ranges(lines.some(cell), limit))
                cell = cell[heard]
                found[cell] = limit
        return found - 0.5 * step / _FINE

    def steady(self, lines: Sightlines, max_incidence_rad: float) -> NDArray[np.bool_]:
        """Return which readings hardly change with small changes of robot, cone and walls, (m,).

        Those that do come from the edge of something. There the least error of the pose or the
        map decides what is measured, and readings say little of the sensor.
        """
        usual = self.ranges(lines, max_incidence_rad)
        allowed = np.maximum(_CHANGE_M, _CHANGE * np.where(np.isfinite(usual), usual, 0.0))
        steady = np.ones(len(usual), np.bool_)
        for turn in self._turned:
            turned = Sightlines(lines.poses + np.array(turn), lines.sensors)
            steady &= _alike(usual, self.ranges(turned, max_incidence_rad), allowed)
        for echoes in self._others:
            steady &= _alike(usual, _along(echoes.with_limit(max_incidence_rad), lines), allowed)
        if self._endless is not None:
            endless = _along(self._endless.with_limit(max_incidence_rad), lines)
            steady &= _alike(usual, endless, np.full(len(usual), _SAME_M))
        return steady


def _without_ends(walls: WallMap) -> WallMap:
    """Return walls that are a little shorter at both ends, without those that are all ends."""
    a, b = walls.segments[:, :2], walls.segments[:, 2:]
    length = np.hypot(*(b - a).T)[:, np.newaxis]
    inset = _END_M * (b - a) / length
    kept = np.hstack([a + inset, b - inset])[length[:, 0] > 2.0 * _END_M]
    return WallMap(kept) if len(kept) else walls


def _along(echoes: WallEchoes | GridEchoes, lines: Sightlines) -> NDArray[np.float64]:
    """Return the range along each line, (m,) [m]."""
    found = np.empty(len(lines.sensors))
    for sensor in np.unique(lines.sensors).tolist():
        own = np.flatnonzero(lines.sensors == sensor)
        found[own] = echoes.ranges(lines.poses[own], np.array([sensor]))[:, 0]
    return found


def _alike(
    a: NDArray[np.float64], b: NDArray[np.float64], allowed: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return where two ranges differ by no more than allowed, or are both inf."""
    with np.errstate(invalid="ignore"):
        near: NDArray[np.bool_] = np.abs(a - b) <= allowed
    return near | (np.isinf(a) & np.isinf(b))
