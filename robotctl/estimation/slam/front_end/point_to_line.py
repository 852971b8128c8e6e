"""Refinement of a match: Gauss-Newton on the distances of points from pieces of wall.

Each point is compared with the nearest piece that faces the same way, across it; a point without a
piece of wall beside it, in both directions. What does not fit weighs less (Geman and McClure).
Censi, An ICP variant using a point-to-line metric, ICRA 2008.

The information of the result is that of the residuals: nothing along a corridor, where only the
prior holds the pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.front_end.surface import Floats, Surface, corners
from robotctl.model.geometry.se2 import SE2

SIGMA_M: Final = 0.03
"""Standard deviation of a point from a wall [m]: range noise, and walls not quite straight."""
SHARED: Final = 4.0
"""Number of points that share their error: walls are not quite straight, nor ranges unbiased."""
WIDE_M: Final = 0.30
NARROW_M: Final = 0.06
"""Residuals beyond which a point loses its weight, at first and in the end."""
_CELL_M: Final = 0.25
_STEPS: Final = 30
_SETTLED: Final = 1e-4
"""Steps below this are the last [m], [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """A surface, sorted into square bins so that neighbours are found.

    Parameters
    ----------
    points, normals
        Of its outline, (m, 2), bin by bin.
    begins
        Where each bin begins, and the end, (rows * columns + 1,).
    corner
        Of the first bin [m].
    columns, rows
        Numbers of bins.
    """

    points: Floats
    normals: Floats
    begins: NDArray[np.int32]
    corner: Floats
    columns: int
    rows: int


def binned(surface: Surface) -> Bins:
    """Return a surface of at least one point in bins."""
    outline = surface.outline
    low, high = corners(outline)
    corner = np.floor(low / _CELL_M) * _CELL_M
    columns, rows = (int(each) + 1 for each in (high - corner) / _CELL_M)
    begins = np.zeros(rows * columns + 1, np.int32)
    points, normals = np.empty_like(outline), np.empty_like(outline)
    _sort(outline, surface.outline_normals, corner, columns, begins, points, normals)
    return Bins(points, normals, begins, corner, columns, rows)


@compiled
def _sort(
    outline: Floats, facing: Floats, corner: Floats, columns: int, begins: NDArray[np.int32],
    points: Floats, normals: Floats,
) -> None:  # fmt: skip
    """Sort points into bins by counting."""
    bins = np.empty(len(outline), np.int64)
    for k in range(len(outline)):
        column = int((outline[k, 0] - corner[0]) / _CELL_M)
        row = int((outline[k, 1] - corner[1]) / _CELL_M)
        bins[k] = row * columns + column
        begins[bins[k] + 1] += 1
    for each in range(1, len(begins)):
        begins[each] += begins[each - 1]
    ends = begins.copy()
    for k in range(len(outline)):
        at = ends[bins[k]]
        ends[bins[k]] += 1
        points[at], normals[at] = outline[k], facing[k]


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A refined pose.

    Parameters
    ----------
    pose
        Of the scan in the frame of the map.
    information
        (3, 3) in the frame of the pose, of the scan alone, without the prior.
    inliers
        Share of the points, by weight, that lie on the map.
    rms_m
        Of those [m].
    """

    pose: SE2
    information: Floats
    inliers: float
    rms_m: float


def refine(
    bins: Bins,
    surface: Surface,
    start: SE2,
    prior: SE2 | None = None,
    prior_information: Floats | None = None,
    wide_m: float = WIDE_M,
) -> Match:
    """Return the pose of a surface on a map near a start.

    Parameters
    ----------
    bins
        The map.
    surface
        Of the scan, in `base`.
    start
        Pose to begin with.
    prior, prior_information
        What is known otherwise: pose, and information (3, 3) in its frame.
    wide_m
        Residuals beyond which a point loses its weight at first [m].
    """
    known = start if prior is None else prior
    information = np.zeros((3, 3)) if prior_information is None else prior_information
    pose = np.array([start.x_m, start.y_m, start.theta_rad])
    H = np.empty((3, 3))
    inliers, rms_m = _refine(
        bins.points, bins.normals, bins.begins, bins.corner, bins.columns, bins.rows,
        surface.points, surface.normals, surface.weights, pose,
        np.array([known.x_m, known.y_m, known.theta_rad]), information, wide_m, H,
    )  # fmt: skip
    return Match(SE2(*pose.tolist()), H, inliers, rms_m)


def share_on_map(bins: Bins, surface: Surface, pose: SE2) -> float:
    """Return the share of a surface's points, by weight, that lie on a map at a pose."""
    inliers, _ = _normal_equations(
        bins.points, bins.normals, bins.begins, bins.corner, bins.columns, bins.rows,
        surface.points, surface.normals, surface.weights,
        np.array([pose.x_m, pose.y_m, pose.theta_rad]), NARROW_M, np.empty((3, 3)), np.empty(3),
    )  # fmt: skip
    return inliers / max(float(surface.weights.sum()), 1e-9)


@compiled
def _refine(
    points: Floats, normals: Floats, begins: NDArray[np.int32], corner: Floats, columns: int,
    rows: int, own: Floats, own_normals: Floats, weights: Floats, pose: Floats, prior: Floats,
    prior_information: Floats, wide_m: float, H: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Improve a pose; fill the information H; return the share of inliers and their rms."""
    scale = wide_m
    A, g = np.empty((3, 3)), np.empty(3)
    inliers = rms = 0.0
    total = max(weights.sum(), 1e-9)
    for _ in range(_STEPS):
        inliers, rms = _normal_equations(
            points, normals, begins, corner, columns, rows, own, own_normals, weights, pose,
            scale, H, g,
        )  # fmt: skip
        # The prior, of X = prior exp(e): e = log(prior^-1 pose), to first order.
        c, s = np.cos(prior[2]), np.sin(prior[2])
        dx, dy = pose[0] - prior[0], pose[1] - prior[1]
        turn = pose[2] - prior[2]
        turn -= 2.0 * np.pi * np.floor((turn + np.pi) / (2.0 * np.pi))
        ct, st = np.cos(turn), np.sin(turn)
        px, py = c * dx + s * dy, c * dy - s * dx
        e = np.array([ct * px + st * py, ct * py - st * px, turn])
        for i in range(3):
            for j in range(3):
                A[i, j] = H[i, j] + prior_information[i, j]
                g[i] += prior_information[i, j] * e[j]
            A[i, i] += 1e-3 + 1e-6 * A[i, i]
        step = np.linalg.solve(A, -g)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        length = np.hypot(step[0], step[1])
        short = min(1.0, 0.5 / max(length, 1e-9), 0.3 / max(abs(step[2]), 1e-9))
        pose[0] += short * (c * step[0] - s * step[1])
        pose[1] += short * (s * step[0] + c * step[1])
        pose[2] += short * step[2]
        settled = length < _SETTLED and abs(step[2]) < _SETTLED
        if scale <= NARROW_M and settled:
            break
        scale = max(NARROW_M, 0.7 * scale)
    return inliers / total, rms


@compiled
def _normal_equations(
    points: Floats, normals: Floats, begins: NDArray[np.int32], corner: Floats, columns: int,
    rows: int, own: Floats, own_normals: Floats, weights: Floats, pose: Floats, scale: float,
    H: Floats, g: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Fill H and g at a pose; return the weight of inliers and their rms."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    H[:] = 0.0
    g[:] = 0.0
    inliers = squares = 0.0
    most = max(2.0 * scale, 0.2)
    for k in range(len(own)):
        rx, ry = c * own[k, 0] - s * own[k, 1], s * own[k, 0] + c * own[k, 1]
        x, y = pose[0] + rx, pose[1] + ry
        mx = c * own_normals[k, 0] - s * own_normals[k, 1]
        my = s * own_normals[k, 0] + c * own_normals[k, 1]
        is_wall = mx != 0.0 or my != 0.0
        nearest = _nearest(
            points, normals, begins, corner, columns, rows, x, y, mx, my, is_wall, most
        )
        if nearest < 0:
            continue
        ex, ey = x - points[nearest, 0], y - points[nearest, 1]
        nx, ny = normals[nearest, 0], normals[nearest, 1]
        has_wall = nx != 0.0 or ny != 0.0
        if not has_wall and is_wall:
            nx, ny, has_wall = mx, my, True
        # A point from the cross of a wall and a beam that turns with it: d/d theta of R p.
        tx, ty = -ry, rx
        for axis in range(1 if has_wall else 2):
            if has_wall:
                ax, ay = nx, ny
            else:
                ax, ay = 1.0 - axis, 0.0 + axis
            residual = ax * ex + ay * ey
            robust = (scale * scale / (scale * scale + residual * residual)) ** 2
            weight = weights[k] * robust / (SHARED * SIGMA_M * SIGMA_M)
            if not has_wall:
                weight *= 0.1
            # Columns: forward, left, turn in the frame of the pose.
            j0, j1, j2 = ax * c + ay * s, ay * c - ax * s, ax * tx + ay * ty
            H[0, 0] += weight * j0 * j0
            H[0, 1] += weight * j0 * j1
            H[0, 2] += weight * j0 * j2
            H[1, 1] += weight * j1 * j1
            H[1, 2] += weight * j1 * j2
            H[2, 2] += weight * j2 * j2
            g[0] += weight * j0 * residual
            g[1] += weight * j1 * residual
            g[2] += weight * j2 * residual
            if axis == 0 and abs(residual) < 2.0 * scale:
                inliers += weights[k]
                squares += weights[k] * residual * residual
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    return inliers, np.sqrt(squares / max(inliers, 1e-9))


@compiled
def _nearest(
    points: Floats, normals: Floats, begins: NDArray[np.int32], corner: Floats, columns: int,
    rows: int, x: float, y: float, mx: float, my: float, is_wall: bool, most: float,
) -> int:  # fmt: skip
    """Return the nearest point that faces the same way, within `most`; -1: none."""
    best, found = most * most, -1
    low_column = max(int(np.floor((x - most - corner[0]) / _CELL_M)), 0)
    high_column = min(int(np.floor((x + most - corner[0]) / _CELL_M)), columns - 1)
    low_row = max(int(np.floor((y - most - corner[1]) / _CELL_M)), 0)
    high_row = min(int(np.floor((y + most - corner[1]) / _CELL_M)), rows - 1)
    for row in range(low_row, high_row + 1):
        begin = begins[row * columns + low_column]
        end = begins[row * columns + high_column + 1] if high_column >= low_column else begin
        for k in range(begin, end):
            square = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
            if square >= best:
                continue
            has_wall = normals[k, 0] != 0.0 or normals[k, 1] != 0.0
            if is_wall and has_wall and normals[k, 0] * mx + normals[k, 1] * my < 0.7:
                continue
            best, found = square, k
    return found
