"""Free-standing objects on the floor: position of the foot, width and height."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.camera.boundary import FOUND, Boundary
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.scan import ColumnRanges
from robotctl.estimation.camera.strip import GroundStrip

_YES: Final = 1
_NO: Final = 0
_CUT: Final = -1
"""Answers whether floor goes on behind an end; the last: the picture ends there, nothing is known
of the floor."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundObstacle:
    """One object on the floor.

    Attributes
    ----------
    foot_base
        The middle of its foot on the side of the robot, (2,) [m]: halfway in bearing between its
        left and right end.
    foot_covariance
        Of that, (2, 2) [m^2].
    centre_base
        Its middle, if it is as deep as it is wide, (2,) [m].
    centre_covariance
        Of that, (2, 2) [m^2]; says that the depth is not seen.
    width_m
        Across the line of sight [m].
    height_m
        At most so high [m]: the farther edge of its upper face; inf if no floor is seen above.
    cut
        Whether the picture ends at one of its sides: it may be wider.
    """

    foot_base: NDArray[np.float64]
    foot_covariance: NDArray[np.float64]
    centre_base: NDArray[np.float64]
    centre_covariance: NDArray[np.float64]
    width_m: float
    height_m: float
    cut: bool


def find_obstacles(
    strip: GroundStrip,
    boundary: Boundary,
    columns: ColumnRanges,
    things: NDArray[np.float32],
    walls: NDArray[np.float32],
    config: GroundCameraConfig,
) -> tuple[GroundObstacle, ...]:
    """Return free-standing objects: with floor behind on both sides.

    What the picture cuts at one side is told from a wall by its upper edge, below the horizon.

    Parameters
    ----------
    strip
        Gives bearings and heights.
    boundary
        The lowest boundary of each column.
    columns
        How far that is.
    things, walls
        Evidence of coarse cells for any obstacle, and for one that reaches above the horizon,
        (n, columns).
    config
        The least and the largest size.
    """
    found = []
    rules = config.objects
    evidence = np.maximum(things, walls)
    for first, last in _runs(columns.ranges_m, boundary.kinds == FOUND, config):
        mine = np.arange(first, last + 1)
        mine = mine[np.isfinite(columns.ranges_m[mine]) & (boundary.kinds[mine] == FOUND)]
        if (
            len(mine) < rules.columns_min
            or columns.ranges_m[mine].min() > config.obstacle_range_m
            or _extent(strip, columns, mine) > config.obstacle_width_m
        ):
            continue
        distinct = _certain(things, boundary.cells[mine], mine, rules.evidence_min)
        seen = columns.ranges_m, columns.floor_m, columns.own_m
        asked = config.obstacle_gap_m, rules.beside_columns, rules.behind_columns
        ends = [
            _goes_on_behind(*seen, end, step, *asked, distinct)
            for end, step in ((first, -1), (last, 1))
        ]
        if _NO in ends or ends == [_CUT, _CUT]:
            continue
        if not (distinct or _certain(evidence, boundary.cells[mine], mine, rules.evidence_min)):
            continue
        obstacle = _measure(
            strip, boundary, columns, evidence, mine, rules.depth_sigma, cut=_CUT in ends
        )
        if (
            obstacle.width_m >= (config.least_width_m if distinct else rules.indistinct_width_m)
            and obstacle.height_m >= config.least_height_m
            and not (obstacle.cut and math.isinf(obstacle.height_m))
        ):
            found.append(obstacle)
    return tuple(found)


def _extent(strip: GroundStrip, columns: ColumnRanges, mine: NDArray[np.intp]) -> float:
    """Return the distance between the two ends of a boundary [m]."""
    ends = mine[[0, -1]]
    bearings, ranges = strip.bearings_rad[ends], columns.ranges_m[ends]
    return math.hypot(
        *np.diff([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=1).ravel()
    )


def _certain(
    evidence: NDArray[np.float32], cells: NDArray[np.intp], mine: NDArray[np.intp], least: float
) -> bool:
    """Return whether an object on a boundary is a separate obstacle, by its mean evidence."""
    second = np.minimum(cells + 1, len(evidence) - 1)
    body = np.maximum(evidence[cells, mine], evidence[second, mine])
    return bool(body.mean() >= least)


def _runs(
    ranges: NDArray[np.float64], found: NDArray[np.bool_], config: GroundCameraConfig
) -> list[tuple[int, int]]:
    """Return first and last column of each connected part."""
    columns = np.flatnonzero(found & np.isfinite(ranges))
    if columns.size == 0:
        return []
    r = ranges[columns]
    apart = np.diff(columns) > config.objects.bridged_columns + 1
    share = config.objects.gap_share
    apart |= np.abs(np.diff(r)) > config.obstacle_gap_m + share * np.minimum(r[1:], r[:-1])
    starts = np.concatenate([[0], np.flatnonzero(apart) + 1])
    ends = np.concatenate([np.flatnonzero(apart), [len(columns) - 1]])
    return [(int(columns[a]), int(columns[b])) for a, b in zip(starts, ends, strict=True)]


@compiled
def _goes_on_behind(
    ranges: NDArray[np.float64],
    floor: NDArray[np.float64],
    own: NDArray[np.float64],
    end: int,
    step: int,
    gap_m: float,
    beside: int,
    least: int,
    distinct: bool,
) -> int:
    """Return whether the floor beside an end continues behind it: `_YES`, `_NO` or `_CUT`.

    So many columns beside it are asked, of which at least so many must show it.

    Where floor and wall are hardly told from each other, only what is `distinct` from both stands
    free: such a wall comes in pieces.
    """
    judged, behind, unclear = 0, 0, 0
    for k in range(1, beside + 1):
        c = end + step * k
        if not 0 <= c < len(ranges):
            break
        if np.isnan(floor[c]):
            unclear += 1
            continue
        farther = floor[c] - ranges[end]
        # Where the picture ends, what is seen of the floor has to reach beyond.
        if np.isnan(ranges[c]) and farther <= gap_m:
            continue
        judged += 1
        noise = own[end] if np.isnan(own[c]) else np.hypot(own[c], own[end])
        behind += farther > gap_m + 3.0 * noise
    if 2 * unclear > beside:
        return _YES if distinct else _NO
    if judged == 0:
        return _CUT
    return _YES if behind >= min(least, judged) else _NO


def _measure(
    strip: GroundStrip,
    boundary: Boundary,
    columns: ColumnRanges,
    evidence: NDArray[np.float32],
    mine: NDArray[np.intp],
    depth_sigma: float,
    *,
    cut: bool,
) -> GroundObstacle:
    """Return position and size of the object in some columns."""
    first, last = int(mine[0]), int(mine[-1])
    bearing = (strip.bearings_rad[first] + strip.bearings_rad[last]) / 2
    third = max(1, len(mine) // 6)
    middle = mine[len(mine) // 2 - third : len(mine) // 2 + third + 1]
    range_m = float(np.median(columns.ranges_m[middle]))
    width_m = range_m * (last - first + 1) * strip.column_rad
    along = np.array([math.cos(bearing), math.sin(bearing)])
    across = np.array([-along[1], along[0]])
    sigma_along = float(np.median(np.hypot(columns.own_m, columns.common_m)[middle]))
    sigma_across = math.hypot(range_m * strip.column_rad, 0.05 * width_m)
    foot = strip.camera.t_base_camera[:2] + range_m * along

    def covariance(deep: float, wide: float) -> NDArray[np.float64]:
        both: NDArray[np.float64] = deep**2 * np.outer(along, along) + wide**2 * np.outer(
            across, across
        )
        return both

    spread = depth_sigma * width_m
    return GroundObstacle(
        foot,
        covariance(sigma_along, sigma_across),
        foot + width_m / 2 * along,
        covariance(math.hypot(sigma_along, spread), math.hypot(sigma_across, 0.1 * width_m)),
        width_m,
        _height(strip, evidence, boundary.cells[middle], middle, range_m),
        cut,
    )


def _height(
    strip: GroundStrip,
    evidence: NDArray[np.float32],
    cells: NDArray[np.intp],
    columns: NDArray[np.intp],
    range_m: float,
) -> float:
    """Return how high a thing reaches in some columns, the middle of them [m]."""
    tops = []
    for cell, column in zip(cells, columns, strict=True):
        above = evidence[cell:, column] > 0.0
        # One cell of another look does not end it.
        ends = np.flatnonzero(~above[:-1] & ~above[1:])
        tops.append(cell + int(ends[0]) if ends.size else len(evidence))
    row = int(strip.edges[int(np.median(tops))])
    if row >= strip.horizon_row:
        return math.inf
    return strip.height_m - range_m * math.tan(strip.depression_rad[row])
