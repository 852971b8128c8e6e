"""Floor boundary in each column of the strip: found coarsely, then to a fraction of a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.camera.colour import L_BINS, LIT, SATURATED_BIN, SHADOWED
from robotctl.estimation.camera.config import BoundaryConfig

FREE: Final = 0
"""Floor up to the horizon or as far as is judged."""
FOUND: Final = 1
"""A boundary."""
BLOCKED: Final = 2
"""No floor from the first row on: the object begins nearer than the picture."""
UNSEEN: Final = 3
"""The picture ends before anything is found."""
UNCLEAR: Final = 4
"""No boundary, but floor and wall cannot be distinguished there."""

_FOOT_COLUMNS: Final = 21
"""Columns over whose median the feet of walls are smoothed: odd, for OpenCV."""


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """The lowest boundary of each column.

    Attributes
    ----------
    kinds
        `FREE`, `FOUND`, `BLOCKED`, `UNSEEN` or `UNCLEAR`, (columns,).
    cells
        The coarse row of the boundary, (columns,).
    rows
        Rows of the boundary, to parts of a row, (columns,); nan if there is none.
    noise_rows
        How much texture and noise blur it, a standard deviation, (columns,); nan as there.
    """

    kinds: NDArray[np.int8]
    cells: NDArray[np.intp]
    rows: NDArray[np.float64]
    noise_rows: NDArray[np.float64]


def find_boundary(
    evidence: NDArray[np.float32],
    walls: NDArray[np.float32],
    strip: NDArray[np.uint8],
    means: NDArray[np.float32],
    edges: NDArray[np.intp],
    first: NDArray[np.intp],
    beyond: NDArray[np.intp],
    last: int,
    horizon: int,
    config: BoundaryConfig = BoundaryConfig(),  # noqa: B008
) -> Boundary:
    """Return the lowest boundary between floor and obstacles in each column.

    Parameters
    ----------
    evidence
        For an obstacle, of coarse cells, (n, columns).
    walls
        For one that reaches above the horizon, (n, columns).
    strip
        BGR, (rows, 2 columns, 3).
    means
        Mean BGR of coarse cells, (n, columns, 3).
    edges
        Rows at which the coarse rows begin and, last, end, (n + 1,).
    first, beyond
        The first coarse row that is judged, and the first after it that the picture does not
        show, of each column, (columns,).
    last
        Coarse rows from here on are farther than is judged.
    horizon
        Coarse rows from here on are above the horizon.
    config
        Settings.
    """
    columns = evidence.shape[1]
    kinds = np.empty(columns, np.int8)
    cells = np.zeros(columns, np.intp)
    feet = wall_feet(walls, horizon, config)
    _first_cells(evidence, feet, first, beyond, last, config.evidence_min, kinds, cells)
    # Only a column that does not look like floor above the horizon can be trusted to be free.
    differs = walls[horizon + 1 :] > 0.0
    share = differs.mean(axis=0) if len(differs) else np.zeros(columns)
    kinds[(kinds == FREE) & (share < config.free_differs_min)] = UNCLEAR
    rows = np.full(columns, np.nan)
    noise = np.full(columns, np.nan)
    _refine(
        strip, means, edges, first, kinds, cells, config.edge_rows, config.flat_rows, rows, noise
    )
    return Boundary(kinds, cells, rows, noise)


def wall_feet(
    walls: NDArray[np.float32],
    horizon: int,
    config: BoundaryConfig = BoundaryConfig(),  # noqa: B008
) -> NDArray[np.intp]:
    """Return the lowest row of what reaches above the horizon, (columns,); n if nothing does.

    From above the horizon downwards evidence is summed; the sum is largest at the foot. So a wall
    that hardly differs from the floor is found by all of its height.

    Parameters
    ----------
    walls
        Evidence for an obstacle that reaches above the horizon, (n, columns).
    horizon
        Coarse rows from here on are above the horizon.
    config
        Settings.
    """
    n = len(walls)
    top = min(horizon + config.wall_rows, n)
    if top <= horizon:
        return np.full(walls.shape[1], n)
    each = np.clip(walls[:top], -1.5, 1.5) - np.float32(config.wall_doubt)
    wide = cv2.blur(each, (5, 1), borderType=cv2.BORDER_REPLICATE)
    sums = np.cumsum(np.asarray(wide)[::-1], axis=0)
    best = np.argmax(sums, axis=0)
    columns = np.arange(walls.shape[1])
    foot = top - 1 - best
    sure = (sums[best, columns] >= config.wall_evidence_min) & (foot < horizon)
    # A foot that leaps down in few columns is floor that looks like the wall.
    levels = np.clip(foot, 0, 255).astype(np.uint8)[None]
    smooth = np.asarray(cv2.medianBlur(levels, _FOOT_COLUMNS), np.float64)[0]
    sure &= foot >= smooth - config.foot_leap_rows
    return np.where(sure, foot, n)


def judge_lights(
    evidence: NDArray[np.float32],
    bins: NDArray[np.int32],
    widths: NDArray[np.float64],
    config: BoundaryConfig = BoundaryConfig(),  # noqa: B008
) -> None:
    """Turn blobs of the floor's colour that no light explains into obstacles, in place.

    A shadow lies beside what casts it. A small isolated dark blob may be the shadow of something
    out of the picture, or a dark thing of the floor's colour; a small bright blob may be a patch of
    sun, or a bright thing: it counts as an object if its edge is sharp.

    Parameters
    ----------
    evidence
        For an obstacle, of coarse cells, (n, columns); changed.
    bins
        Their colours, (n, columns).
    widths
        Columns that a single obstacle covers at most, of each coarse row, (n,).
    config
        Settings.
    """
    obstacle = evidence > config.neighbour_evidence_min
    for light in (SHADOWED, LIT):
        blobs = np.asarray(evidence == np.float32(light), np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(blobs, connectivity=8)
        wide, high, area = stats[:, 2], stats[:, 3], stats[:, 4]
        small = (wide >= 2) & (high >= 2) & (area >= 6) & (wide <= widths[stats[:, 1]])
        for label in np.flatnonzero(small[1:count]) + 1:
            left, low, across, up = (int(value) for value in stats[label, :4])
            around = np.s_[max(0, low - 1) : low + up + 1, max(0, left - 1) : left + across + 1]
            mine = labels[around] == label
            near = (cv2.dilate(mine.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~mine
            touching = near & obstacle[around]
            brightness = bins[around] % L_BINS
            level = _mean_of(brightness, mine)
            step = level - _mean_of(brightness, near & ~touching)
            if not abs(step) >= config.sharp_bins or level > SATURATED_BIN - 1:
                continue
            beside = obstacle[
                max(0, low - up) : low + 2 * up, max(0, left - across) : left + 2 * across
            ]
            cast = touching.any() and beside.sum() >= config.caster_share * area[label]
            if light == LIT or not cast:
                evidence[around][mine] = config.thing_evidence


def _mean_of(values: NDArray[np.int32], which: NDArray[np.bool_]) -> float:
    """Return the mean of some values, nan for none."""
    return float(values[which].mean()) if which.any() else math.nan


@compiled
def _first_cells(
    evidence: NDArray[np.float32],
    feet: NDArray[np.intp],
    first: NDArray[np.intp],
    beyond: NDArray[np.intp],
    last: int,
    least: float,
    kinds: NDArray[np.int8],
    cells: NDArray[np.intp],
) -> None:
    """Find the first coarse row of each column at which an obstacle of least evidence begins."""
    n, columns = evidence.shape
    for c in range(columns):
        left, right = max(c - 1, 0), min(c + 1, columns - 1)
        end = min(beyond[c] - 1, last)
        kinds[c] = FREE if beyond[c] > last else UNSEEN
        if first[c] >= n:
            kinds[c] = UNSEEN
        for i in range(first[c], end):
            total = np.float32(0.0)
            for row in (i, i + 1):
                total += evidence[row, left] + evidence[row, c] + evidence[row, right]
            if i == feet[c] or (evidence[i, c] > 0.0 and total > 6.0 * least):
                kinds[c] = BLOCKED if i == first[c] else FOUND
                cells[c] = i
                break


@compiled
def _refine(
    strip: NDArray[np.uint8],
    means: NDArray[np.float32],
    edges: NDArray[np.intp],
    first: NDArray[np.intp],
    kinds: NDArray[np.int8],
    cells: NDArray[np.intp],
    edge_rows: int,
    flat_rows: int,
    rows: NDArray[np.float64],
    noise: NDArray[np.float64],
) -> None:
    """Fit a step between the colours before and behind to each boundary that was found."""
    n, columns = means.shape[:2]
    profile = np.empty((len(strip), 3))
    for c in range(columns):
        if kinds[c] != FOUND:
            continue
        i = cells[c]
        low, high = edges[max(i - 1, first[c])], edges[min(i + 1, n)]
        bottom, top = edges[max(i - 2, first[c])], edges[min(i + 2, n)]
        left, right = 2 * max(c - 1, 0), 2 * min(c + 1, columns - 1) + 2
        for row in range(bottom, top):
            for k in range(3):
                total = 0
                for u in range(left, right):
                    total += strip[row, u, k]
                profile[row, k] = total / (right - left)
        step = _split(profile, bottom, low, high, top)
        # A step of two even colours, spread by the lens: its place is where the area is equal.
        start, end = max(step - edge_rows, bottom), min(step + edge_rows, top)
        low_flat, high_flat = max(start - flat_rows, bottom), min(end + flat_rows, top)
        place, rms = _area(profile, low_flat, start, end, high_flat, step)
        rows[c] = place - 0.5
        noise[c] = rms


@compiled
def _split(profile: NDArray[np.float64], bottom: int, low: int, high: int, top: int) -> int:
    """Return the row in [low, high] that best parts [bottom, top) into two even colours."""
    before, behind = np.zeros(3), np.zeros(3)
    for k in range(3):
        for row in range(bottom, low):
            before[k] += profile[row, k]
        for row in range(low, top):
            behind[k] += profile[row, k]
    best, at = -1.0, low
    for row in range(low, high + 1):
        # Least squares of two constants: the largest sum of squared sums over counts.
        m, n = row - bottom, top - row
        if m > 0 and n > 0:
            score = 0.0
            for k in range(3):
                score += before[k] ** 2 / m + behind[k] ** 2 / n
            if score > best:
                best, at = score, row
        if row < top:
            for k in range(3):
                before[k] += profile[row, k]
                behind[k] -= profile[row, k]
    return at


@compiled
def _area(
    profile: NDArray[np.float64], bottom: int, start: int, end: int, top: int, step: int
) -> tuple[float, float]:
    """Return where between two rows the step of equal area is, and its noise [rows]."""
    start = max(start, min(bottom + 1, step))
    end = min(end, max(top - 1, step))
    if start <= bottom or end >= top:
        return float(step), 1.0
    floor = _mean(profile, bottom, start)
    towards = _mean(profile, end, top) - floor
    scale = np.sum(towards * towards)
    if scale < 1.0:
        return float(step), 2.0
    area, square = 0.0, 0.0
    for row in range(bottom, top):
        share = np.sum((profile[row] - floor) * towards) / scale
        if start <= row < end:
            area += min(max(share, -0.25), 1.25)
        else:
            square += (share - (1.0 if row >= end else 0.0)) ** 2
    rms = np.sqrt(square / (start - bottom + top - end))
    return min(max(end - area, start), end), min(rms * np.sqrt(end - start), 3.0)


@compiled
def _mean(profile: NDArray[np.float64], start: int, end: int) -> NDArray[np.float64]:
    """Return the mean colour of rows, (3,)."""
    mean = np.zeros(3)
    for row in range(start, end):
        mean += profile[row]
    return mean / (end - start)
