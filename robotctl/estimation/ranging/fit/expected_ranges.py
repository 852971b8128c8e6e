"""Expected ranges at known poses, and the incidence of sound or light.

For sonars and lidar: a lidar beam is a sonar with a very narrow cone. How far each should measure
is `wall_echoes.py` or `grid_echoes.py`. The incidence of a reading is the least angle to a
surface's normal in its cone: below the sensor's limit there is an echo, and if there is none,
the limit is lower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.sonar_cones import Echoes, SonarCones
from robotctl.estimation.ranging.sonar_model import echoes_in
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

_OPEN_RAD: Final = math.radians(89.5)
_COARSE: Final = 45
_FINE: Final = 20
_STEP_RAD: Final = _OPEN_RAD / (_COARSE * _FINE)
_TURN_RAD: Final = math.radians(1.0)
_BEAM: Final = 0.1
_END_M: Final = 0.15
"""Small changes of turn, cone and wall length that should not change a reading."""
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
        Distance beyond which obstacles are ignored; more than any sensor's range [m].
    """

    def __init__(
        self,
        room: WallMap | GridMap,
        mounts: NDArray[np.float64],
        beam_rad: float,
        reach_m: float,
    ) -> None:
        def echoes(room: WallMap | GridMap, share: float = 1.0) -> Echoes:
            return echoes_in(room, SonarCones(mounts, share * beam_rad, _OPEN_RAD, reach_m))

        self._echoes = echoes(room)
        self._others = [echoes(room, 1.0 - _BEAM), echoes(room, 1.0 + _BEAM)]
        self._endless = echoes(_without_ends(room)) if isinstance(room, WallMap) else None
        self._turned = [(0.0, 0.0, _TURN_RAD), (0.0, 0.0, -_TURN_RAD)]

    @property
    def open_rad(self) -> float:
        """The incidence limit of a sensor that receives nearly all echoes [rad]."""
        return _OPEN_RAD

    @property
    def step_rad(self) -> float:
        """Accuracy of incidences [rad]."""
        return _STEP_RAD

    def ranges(
        self, lines: Sightlines, max_incidence_rad: float = _OPEN_RAD
    ) -> NDArray[np.float64]:
        """Return how far each should measure, (m,) [m]; inf if nothing sends an echo."""
        return _along(self._echoes.with_limit(max_incidence_rad), lines)

    def ranges_at(
        self, lines: Sightlines, incidences_rad: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return how far each would measure with an incidence limit of its own, (m,) [m]."""
        found = np.full(len(incidences_rad), math.inf)
        known = incidences_rad[np.isfinite(incidences_rad)]
        for limit in np.unique(known).tolist():
            own = np.flatnonzero(incidences_rad == limit)
            found[own] = self.ranges(lines.some(own), limit + _STEP_RAD)
        return found

    def incidences(self, lines: Sightlines) -> NDArray[np.float64]:
        """Return the least incidence at which each meets a surface, (m,) [rad]; inf: none.

        In the middle of a step of `step_rad`.
        """
        return _least_incidences(self._echoes, lines)

    def free_of_edges(
        self, lines: Sightlines, incidences_rad: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which do not meet an edge where they meet a surface most squarely, (m,).

        There, at their `incidences`, walls that are a little shorter do as well.
        """
        if self._endless is None:
            return np.ones(len(lines.sensors), np.bool_)
        endless = _least_incidences(self._endless, lines)
        return _alike(incidences_rad, endless, np.full(len(endless), 0.5 * _STEP_RAD))

    def steady(
        self, lines: Sightlines, max_incidence_rad: float, usual: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which readings hardly change with small changes of robot, cone and walls, (m,).

        Those that do come from the edge of something. There the least error of the pose or the
        map decides what is measured, and readings say little of the sensor. `usual` are their
        `ranges` without such changes.
        """
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


def _least_incidences(echoes: Echoes, lines: Sightlines) -> NDArray[np.float64]:
    """Return the middle of the step in which each is first heard as the limit rises, (m,) [rad]."""
    steps = np.full(len(lines.sensors), _COARSE * _FINE + 1)
    silent = np.arange(len(steps))
    for coarse in range(1, _COARSE + 1):
        limit = coarse * _FINE * _STEP_RAD
        heard = np.isfinite(_along(echoes.with_limit(limit), lines.some(silent)))
        begun = silent[heard]
        steps[begun] = coarse * _FINE
        silent = silent[~heard]
        for fine in range(coarse * _FINE - 1, (coarse - 1) * _FINE, -1):
            if len(begun) == 0:
                break
            limited = echoes.with_limit(fine * _STEP_RAD)
            begun = begun[np.isfinite(_along(limited, lines.some(begun)))]
            steps[begun] = fine
    found: NDArray[np.float64] = np.where(
        steps > _COARSE * _FINE, math.inf, (steps - 0.5) * _STEP_RAD
    )
    return found


def _without_ends(walls: WallMap) -> WallMap:
    """Return walls that are a little shorter at both ends, without those that are all ends."""
    a, b = walls.segments[:, :2], walls.segments[:, 2:]
    length = np.hypot(*(b - a).T)[:, np.newaxis]
    inset = _END_M * (b - a) / length
    kept = np.hstack([a + inset, b - inset])[length[:, 0] > 2.0 * _END_M]
    return WallMap(kept) if len(kept) else walls


def _along(echoes: Echoes, lines: Sightlines) -> NDArray[np.float64]:
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
