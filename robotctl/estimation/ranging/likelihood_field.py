"""The likelihood field: how well the end points of a scan's beams lie on a map's obstacles.

A beam that ends at a distance d from the nearest obstacle of the map has the likelihood

    p(d) = (exp(-d^2 / 2 sigma^2) + K) / (1 + K),

a robust likelihood (Thrun, Burgard, Fox: Probabilistic Robotics, table 6.3,
with the uniform part in K). Beams are multiplied: their logs, kept for each cell of the map, are
added. The sum is then scaled by a power below 1, since beams are not independent given the pose
(`beam_selection.py`). Without it sixty beams claim centimetres that they do not know: particles
near the truth die out, and a wrong place that fits by chance takes over.

- A beam without a valid reading, or with nothing in range, is left out: the field does not know how
  far a beam should reach.
- Outside of the map, and where nothing is near, a beam has the least likelihood, K / (1 + K).
- Unknown cells are no obstacles. A beam that ends a little behind a wall, where no beam ever
  reached, keeps its likelihood by the distance to the wall.
- A beam that says how sure it is has the variance of the field and its own, rounded to one of a
  few: each is a table of its own. What the map's cells hold is their distance, one byte.
- The field cannot see that a beam goes through a wall. Casting its rays took 40 to 60 times as long
  and tracked no better (docs/decisions.md).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.ranging.beam_selection import evenly_chosen, judges, tempering
from robotctl.estimation.ranging.distance_field import SQUARES, distance_bytes
from robotctl.estimation.ranging.likelihood_config import LikelihoodFieldConfig
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.model.grid_map import OCCUPIED_FROM, GridMap
from robotctl.model.sensors.range_scan import RangeScan

_LEVELS = 9
"""Number of distinct standard deviations, each sqrt(2) times the previous: up to 16 times."""
_REACHES_M: Final = 0.05 * 2.0 ** (0.5 * np.arange(13))
"""Reaches of coarse beams [m]: obstacles count as nearer by so much."""
_COARSE_BEAMS: Final = 20
"""Beams of a coarse likelihood: few, as it only tells which places are worth a look."""
_REACHED: Final = 0.8
"""Share of the distance to the end of the surroundings that a coarse beam reaches."""
_BLOCK = 128
"""Particles weighed together: their sums stay in the first-level cache."""


class LikelihoodField:
    """Log-likelihoods of scans on an occupancy grid.

    Parameters
    ----------
    grid
        The map; cells with at least 50 percent are obstacles.
    config
        Weights of beams.

    Raises
    ------
    ValueError
        If the map has no obstacle: every pose would be alike.
    """

    def __init__(self, grid: GridMap, config: LikelihoodFieldConfig | None = None) -> None:
        self.config = config or LikelihoodFieldConfig()
        self._distances = _from_obstacles(grid)
        distance_m = np.sqrt(SQUARES) * grid.resolution_m
        levels = [
            self._log(distance_m.astype(np.float32), 2.0 ** (0.5 * k)) for k in range(_LEVELS)
        ]
        levels += [
            self._log(np.maximum(distance_m - reach, 0.0).astype(np.float32), 1.0)
            for reach in _REACHES_M
        ]
        self._logs = np.stack(levels)
        self._grid = grid
        origin = grid.origin
        self._map_from_world = np.array(
            [
                origin.x_m,
                origin.y_m,
                math.cos(origin.theta_rad),
                math.sin(origin.theta_rad),
                1.0 / grid.resolution_m,
            ]
        )
        far_m = np.array(self.config.skipping.sigmas * self.config.sigma_m, np.float32)
        self._agrees = np.float32(self._log(far_m, 1.0))
        self._caster = RangeCaster(grid, is_small=True)

    def measurement(self, scan: RangeScan) -> LogLikelihood:
        """Return the function from poses to the log-likelihood of a scan.

        The first poses that it is asked for, the belief, decide which beams are skipped; the
        same beams then weigh all others, so that belief and other places compare.
        """
        return _ScanLikelihood(self, scan)

    def log_likelihood(self, poses: NDArray[np.float64], scan: RangeScan) -> NDArray[np.float64]:
        """Return the log-likelihood of a scan at each pose.

        Parameters
        ----------
        poses
            Poses of `base` in `world`, (n, 3) [m, m, rad].
        scan
            The measurement.

        Returns
        -------
        NDArray
            (n,), at most 0: 0 if all chosen beams end in obstacles, and everywhere if no beam
            hit anything.
        """
        return self.measurement(scan)(poses)

    def _log(self, distance_m: NDArray[np.float32], wider: float) -> NDArray[np.float32]:
        """Return log p(d), at most 0, with a standard deviation `wider` than that of the field."""
        k = self.config.robust_k
        hit = np.exp(-0.5 * (distance_m / (wider * self.config.sigma_m)) ** 2)
        result: NDArray[np.float32] = np.log((hit + k) / (1.0 + k)).astype(np.float32)
        return result

    def _chosen(self, scan: RangeScan) -> _Beams:
        """Return the chosen beams of a scan, with the fields that they need."""
        chosen = evenly_chosen(scan.echoes, self.config.beams)
        points = self._points(scan, chosen)
        levels = np.zeros(len(chosen), np.int64)
        if scan.sigmas_m is not None and len(chosen):
            wider = np.hypot(1.0, scan.sigmas_m[chosen] / self.config.sigma_m)
            levels = np.minimum(np.rint(2.0 * np.log2(wider)), _LEVELS - 1).astype(np.int64)
        return _Beams(points, levels)

    def _coarse(self, scan: RangeScan, side_m: float, turn_rad: float) -> _Beams:
        """Return a few beams of a scan, with the fields of how far each end point may be off."""
        chosen = evenly_chosen(scan.echoes, min(self.config.beams, _COARSE_BEAMS))
        reach_m = _REACHED * (side_m / math.sqrt(2.0) + scan.ranges_m[chosen] * turn_rad / 2.0)
        if scan.sigmas_m is not None:
            reach_m += scan.sigmas_m[chosen]
        nearest = np.rint(2.0 * np.log2(reach_m / _REACHES_M[0])).astype(np.int64)
        levels = _LEVELS + np.clip(nearest, 0, len(_REACHES_M) - 1)
        return _Beams(self._points(scan, chosen), levels)

    def _points(self, scan: RangeScan, chosen: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the end points of beams in `base`, (2, k) [cells]."""
        angles, ranges = scan.angles_rad[chosen], scan.ranges_m[chosen]
        points = np.stack([scan.x_m + ranges * np.cos(angles), scan.y_m + ranges * np.sin(angles)])
        in_cells: NDArray[np.float32] = (points * self._map_from_world[4]).astype(np.float32)
        return in_cells

    def _hidden(
        self, poses: NDArray[np.float64], scan: RangeScan, levels: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return which of the chosen beams end before the map allows, (k, n), from each pose."""
        chosen = evenly_chosen(scan.echoes, self.config.beams)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * scan.x_m - s * scan.y_m
        y = poses[:, 1] + s * scan.x_m + c * scan.y_m
        expected_m = self._caster.cast(
            np.stack([x, y, poses[:, 2]], axis=1), scan.angles_rad[chosen], scan.max_range_m
        )
        near_m = self.config.hidden_sigmas * self.config.sigma_m * 2.0 ** (0.5 * levels)
        hidden: NDArray[np.bool_] = (scan.ranges_m[chosen] + near_m)[:, np.newaxis] < expected_m
        return hidden

    def _summed(
        self, poses: NDArray[np.float64], beams: _Beams, inset: int = 0
    ) -> NDArray[np.float64]:
        """Return the sum of the beams' logs at each pose, (n,).

        With an `inset` of 1 what lies off the map counts as its outermost cells, else as far.
        """
        total = np.empty(len(poses))
        cos, sin = self._heading(poses)
        place, cells = self._map_from_world, self._distances
        _weigh(poses, cos, sin, *beams, place, cells, self._logs, np.float32(inset), total)
        return total

    def _summed_forgiving(
        self, poses: NDArray[np.float64], beams: _Beams, hidden: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return the same, where beams that are `hidden`, (k, n), keep `hidden_likelihood`.

        Whatever hides the map stands in its free space: off the map nothing is tolerated.
        """
        total = np.zeros(len(poses))
        cos, sin = self._heading(poses)
        _forgive(
            poses,
            cos,
            sin,
            *beams,
            self._map_from_world,
            self._distances,
            self._logs,
            self._grid.cells,
            hidden,
            math.log(self.config.hidden_likelihood),
            total,
        )
        return total

    def _heading(
        self, poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return cosine and sine of the headings in the map; numpy's are vectorised."""
        heading = (poses[:, 2] - self._grid.origin.theta_rad).astype(np.float32)
        return np.cos(heading), np.sin(heading)

    def _without_skipped(self, poses: NDArray[np.float64], beams: _Beams) -> _Beams:
        """Return the beams that enough poses agree with."""
        few = judges(poses, self.config.skipping)
        if few is None:
            return beams
        cos, sin = self._heading(few)
        agreeing = np.zeros(len(beams.levels))
        _count_agreeing(
            few,
            cos,
            sin,
            *beams,
            self._map_from_world,
            self._distances,
            self._logs,
            self._agrees,
            agreeing,
        )
        kept = self.config.skipping.kept(agreeing / len(few))
        return _Beams(np.ascontiguousarray(beams.points[:, kept]), beams.levels[kept])


def _from_obstacles(grid: GridMap) -> NDArray[np.uint8]:
    """Return how far cells are from obstacles, of which there must be one."""
    occupied = grid.occupied()
    if not occupied.any():
        raise ValueError("the map has no obstacle: no cell is occupied with 50 % or more")
    return distance_bytes(occupied)


class _ScanLikelihood:
    """Log-likelihood of a scan: `Forgiving` and `Coarse`."""

    def __init__(self, field: LikelihoodField, scan: RangeScan) -> None:
        self._field, self._scan = field, scan
        self._all = self._beams = field._chosen(scan)
        self._alpha = tempering(len(self._all.levels), field.config.beam_correlation)
        self._undecided = field.config.skipping.enabled and len(self._all.levels) > 0

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._undecided:
            self._beams, self._undecided = self._field._without_skipped(poses, self._all), False
        return self._alpha * self._field._summed(poses, self._beams)

    def forgiven(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        field = self._field
        hidden = field._hidden(poses, self._scan, self._all.levels)
        return self._alpha * field._summed_forgiving(poses, self._all, hidden)

    def coarse(self, side_m: float, turn_rad: float) -> LogLikelihood:
        beams = self._field._coarse(self._scan, side_m, turn_rad)
        return partial(self._field._summed, beams=beams, inset=1)


class _Beams(NamedTuple):
    """End points in `base`, (2, k) [cells], and which field weighs each, (k,)."""

    points: NDArray[np.float32]
    levels: NDArray[np.int64]


@compiled
def _weigh(
    poses: NDArray[np.float64],
    cos: NDArray[np.float32],
    sin: NDArray[np.float32],
    points: NDArray[np.float32],
    levels: NDArray[np.int64],
    map_from_world: NDArray[np.float64],
    distances: NDArray[np.uint8],
    logs: NDArray[np.float32],
    inset: np.float32,
    total: NDArray[np.float64],
) -> None:
    """Fill `total` with the sum of each beam's field at its end point, for each pose.

    Beams are the outer loop and a block of poses the inner one: then the inner loops are free of
    branches and sums, which the compiler turns into vector code, and where poses are close
    together they look up neighbouring cells.
    """
    n, beams = len(poses), points.shape[1]
    x0, y0, c0, s0, scale = map_from_world
    rows, columns = distances.shape
    flat = distances.reshape(rows * columns)
    stride = np.int32(columns)
    zero = np.float32(0.0)
    last_u, last_v = np.float32(columns - 1) - inset, np.float32(rows - 1) - inset
    u, v = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    cell, summed = np.empty(_BLOCK, np.uint32), np.empty(_BLOCK, np.float32)
    for start in range(0, n, _BLOCK):
        size = min(_BLOCK, n - start)
        c, s = cos[start : start + size], sin[start : start + size]
        for i in range(size):
            x, y = poses[start + i, 0] - x0, poses[start + i, 1] - y0
            u[i] = (c0 * x + s0 * y) * scale + 1.0
            v[i] = (c0 * y - s0 * x) * scale + 1.0
            summed[i] = zero
        for k in range(beams):
            px, py = points[0, k], points[1, k]
            for i in range(size):
                column = u[i] + c[i] * px - s[i] * py
                row = v[i] + s[i] * px + c[i] * py
                column = column if column > inset else inset
                column = column if column < last_u else last_u
                row = row if row > inset else inset
                row = row if row < last_v else last_v
                cell[i] = np.uint32(np.int32(row) * stride + np.int32(column))
            log = logs[levels[k]]
            for i in range(size):
                summed[i] += log[flat[cell[i]]]
        for i in range(size):
            total[start + i] = summed[i]


@compiled
def _end_cell(
    u: float, v: float, cos: np.float32, sin: np.float32, x: np.float32, y: np.float32
) -> tuple[int, int]:
    """Return row and column, in the bordered fields, of a beam's end in `base` from a pose."""
    return math.floor(v + sin * x + cos * y) + 1, math.floor(u + cos * x - sin * y) + 1


@compiled
def _count_agreeing(
    poses: NDArray[np.float64],
    cos: NDArray[np.float32],
    sin: NDArray[np.float32],
    points: NDArray[np.float32],
    levels: NDArray[np.int64],
    map_from_world: NDArray[np.float64],
    distances: NDArray[np.uint8],
    logs: NDArray[np.float32],
    agrees: np.float32,
    agreeing: NDArray[np.float64],
) -> None:
    """Add to `agreeing` for each beam the number of poses that put it near an obstacle."""
    x0, y0, c0, s0, scale = map_from_world
    for i in range(len(poses)):
        x, y = poses[i, 0] - x0, poses[i, 1] - y0
        u, v = (c0 * x + s0 * y) * scale, (c0 * y - s0 * x) * scale
        for k in range(points.shape[1]):
            row, column = _end_cell(u, v, cos[i], sin[i], points[0, k], points[1, k])
            if 0 <= row < distances.shape[0] and 0 <= column < distances.shape[1]:
                agreeing[k] += logs[levels[k], distances[row, column]] >= agrees


@compiled
def _forgive(
    poses: NDArray[np.float64],
    cos: NDArray[np.float32],
    sin: NDArray[np.float32],
    points: NDArray[np.float32],
    levels: NDArray[np.int64],
    map_from_world: NDArray[np.float64],
    distances: NDArray[np.uint8],
    logs: NDArray[np.float32],
    cells: NDArray[np.int8],
    hidden: NDArray[np.bool_],
    least: float,
    total: NDArray[np.float64],
) -> None:
    """Add to `total` the beams' fields at their end points; a hidden one has `least` at least."""
    x0, y0, c0, s0, scale = map_from_world
    for i in range(len(poses)):
        x, y = poses[i, 0] - x0, poses[i, 1] - y0
        u, v = (c0 * x + s0 * y) * scale, (c0 * y - s0 * x) * scale
        for k in range(points.shape[1]):
            row, column = _end_cell(u, v, cos[i], sin[i], points[0, k], points[1, k])
            column = min(max(column, 0), distances.shape[1] - 1)
            row = min(max(row, 0), distances.shape[0] - 1)
            log = logs[levels[k], distances[row, column]]
            is_inside = 0 < row <= cells.shape[0] and 0 < column <= cells.shape[1]
            is_free = is_inside and 0 <= cells[row - 1, column - 1] < OCCUPIED_FROM
            total[i] += max(log, least) if hidden[k, i] and is_free else log
