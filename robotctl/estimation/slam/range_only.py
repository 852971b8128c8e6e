"""SLAM by odometry and ranges to beacons, whose places need not be known.

After a drift of many metres ranges fit no place at all: the drive is solved in pieces from its
start, each half as long again as the one before. In each, a beacon begins where random handfuls of
its ranges meet and most of the others agree, or where it was, whichever fits better: beside a
straight drive it may be on either side, until a bend tells. Ranges count through a robust kernel,
at a noise that the median of their residuals tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.landmarks import RANGE
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import POINT2, SE2, Floats
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.batch import levenberg_marquardt
from robotctl.estimation.slam.solvers.problem import Problem, nobody
from robotctl.estimation.slam.start.points import meeting_point

Ints = NDArray[np.int64]

_KERNEL: Final = KERNELS["geman-mcclure"]
_FIRST_M: Final = 10.0
"""Length of the first piece."""
_GROWTH: Final = 1.5
"""Length of each piece over that of the one before."""
_LEAST_RANGES: Final = 8
"""Ranges of a beacon before it has a place."""
_HANDFUL: Final = 5
_HANDFULS: Final = 40
"""Number of ranges in a random handful, and of handfuls that are tried for a beacon."""
_BEGIN_SIGMA_M: Final = 1.0
_LEAST_SIGMA_M: Final = 0.01
"""Noise of ranges before any fit, and the least that residuals may tell [m]."""
_TO_SIGMA: Final = 1.4826
"""Standard deviation of a Gaussian over the median of its sizes."""
_STILL_M: Final = 2e-3
"""Step of a robot that stands."""
_SIGMA: Final = np.array([0.005, 0.005, 0.002])
_SHARE: Final = np.array([0.05, 0.02, 0.05])
"""Noise of a step: x, y [m] and heading [rad] of one that stands; per distance, distance, turn."""


@dataclass(frozen=True, slots=True, eq=False)
class RangeDrive:
    """A drive among beacons, solved.

    Parameters
    ----------
    graph, values
        Poses, beacons, and all factors; information of ranges is times their weight, so that the
        values are the optimum of the graph as it stands. The first pose is at the origin.
    sigma_m
        Noise of the ranges, as they fit [m].
    weights
        Weight of each range, (m,), 0 to 1.
    turn_bias_rad
        Turn per step that a standing robot measures, and that was taken off [rad].
    """

    graph: FactorGraph
    values: Values
    sigma_m: float
    weights: Floats
    turn_bias_rad: float


def solve_ranges(steps: Floats, rows: Ints, beacons: Ints, ranges: Floats) -> RangeDrive:
    """Return a drive and the places of its beacons.

    Parameters
    ----------
    steps
        Distance [m] and turn [rad] from each pose to the next, (n, 2).
    rows, beacons, ranges
        From which pose which beacon (its index) was how far away, (m,) [m]; some may be false.

    Raises
    ------
    ValueError
        If no beacon has enough ranges.
    """
    still = np.abs(steps[:, 0]) < _STILL_M
    bias = float(np.median(steps[still, 1])) if np.any(still) else 0.0
    z = np.column_stack([steps[:, 0], np.zeros(len(steps)), steps[:, 1] - bias])
    drive = _Pieces(z, rows, beacons, ranges)
    way = np.cumsum(np.abs(z[:, 0]))
    length = _FIRST_M
    while length < way[-1]:
        drive.solve(int(np.searchsorted(way, length)) + 1)
        length *= _GROWTH
    graph, weights = drive.solve(len(z))
    odometry, seen = graph.blocks
    information = seen.information * weights[drive.used, None, None]
    known = FactorBlock(RANGE, seen.variables, seen.measurements, information).informed()
    whole = FactorGraph(graph.ids, (odometry, known))
    values = {SE2: drive.poses, POINT2: drive.places[graph.ids[POINT2]]}
    return RangeDrive(whole, values, drive.sigma, weights, bias)


class _Pieces:
    """A drive whose beginning is solved, and the rest of it by odometry."""

    def __init__(self, z: Floats, rows: Ints, beacons: Ints, ranges: Floats) -> None:
        self._z, self._rows, self._beacons, self._ranges = z, rows, beacons, ranges
        self._information = np.eye(3) / (_SIGMA + _SHARE * np.abs(z[:, [0, 0, 2]]))[:, None] ** 2
        self._rng = np.random.default_rng(0)
        self.poses = _composed(np.zeros(3), z)
        self.places = np.full((int(beacons.max(initial=-1)) + 1, 2), np.nan)
        self.sigma = _BEGIN_SIGMA_M
        self.used = np.empty(0, np.int64)

    def solve(self, end: int) -> tuple[FactorGraph, Floats]:
        """Solve the steps up to `end`; return their graph, and the weight of every range."""
        seen = self._rows <= end
        self._place(seen)
        self.used = used = np.flatnonzero(seen & np.isfinite(self.places[self._beacons, 0]))
        weights = np.zeros(len(self._rows))
        there, names = np.flatnonzero(np.isfinite(self.places[:, 0])), np.arange(end + 1)
        rows, at = self._rows[used], np.searchsorted(there, self._beacons[used])
        z, information = self._ranges[used, None], np.full((len(used), 1, 1), self.sigma**-2)
        blocks = (
            FactorBlock(
                BETWEEN_2D, (names[:-1], names[1:]), self._z[:end], self._information[:end]
            ),
            FactorBlock(RANGE, (rows, at), z, information, _KERNEL),
        )
        graph = FactorGraph({SE2: names, POINT2: there}, blocks)
        if len(used):
            start = {SE2: self.poses[: end + 1], POINT2: self.places[there]}
            found = levenberg_marquardt(Problem(graph, start, np.array([0])), nobody)
            poses, self.places[there] = found.values[SE2], found.values[POINT2]
            self.poses = np.vstack([poses, _composed(poses[-1], self._z[end:])[1:]])
            off = RANGE.residual(poses[rows], self.places[there][at], z)
            self.sigma = max(_LEAST_SIGMA_M, _TO_SIGMA * float(np.median(np.abs(off))))
            weights[used] = found.weights[1]
        elif end == len(self._z):
            raise ValueError(f"no beacon has {_LEAST_RANGES} ranges, which its place needs")
        return graph, weights

    def _place(self, seen: NDArray[np.bool_]) -> None:
        """Set the places of beacons with enough ranges of those seen, (m,)."""
        for beacon, present in enumerate(self.places):
            own = seen & (self._beacons == beacon)
            if np.count_nonzero(own) >= _LEAST_RANGES:
                centres = self.poses[self._rows[own], :2]
                self.places[beacon] = _placed(
                    centres, self._ranges[own], present, self.sigma, self._rng
                )


def _composed(start: Floats, z: Floats) -> Floats:
    """Return the poses (n + 1, 3) of steps (n, 3) from a pose on."""
    heading = start[2] + np.concatenate([[0.0], np.cumsum(z[:, 2])])
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = start[0] + np.concatenate([[0.0], np.cumsum(c * z[:, 0] - s * z[:, 1])])
    y = start[1] + np.concatenate([[0.0], np.cumsum(s * z[:, 0] + c * z[:, 1])])
    return np.column_stack([x, y, heading])


def _placed(
    centres: Floats, ranges: Floats, present: Floats, sigma: float, rng: np.random.Generator
) -> Floats:
    """Return the place of a beacon that most ranges (n,) from places (n, 2) agree with."""

    def misfit(place: Floats) -> float:
        off = np.linalg.norm(centres - place, axis=1) - ranges
        return float(np.sum(np.minimum(off**2, (3.0 * sigma) ** 2)))

    best = present
    least = misfit(present) if np.all(np.isfinite(present)) else np.inf
    for _ in range(_HANDFULS):
        some = rng.choice(len(ranges), _HANDFUL, replace=False)
        place = meeting_point(centres[some], ranges[some])
        if (cost := misfit(place)) < least:
            best, least = place, cost
    return best
