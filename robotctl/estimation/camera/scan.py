"""The boundary of the floor as a range scan, with what it is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.camera.boundary import BLOCKED, FOUND, FREE, UNSEEN, Boundary
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.strip import GroundStrip
from robotctl.model.sensors.range_scan import RangeScan


@dataclass(frozen=True, slots=True, eq=False)
class ColumnRanges:
    """Length of the free floor in each column of the strip.

    Attributes
    ----------
    ranges_m
        (columns,) [m]: inf if nothing is in reach, nan if nothing was judged.
    own_m
        Standard deviation by what differs from column to column, (columns,) [m]; nan if there
        is no range.
    common_m
        That by what all columns share, pitch and calibration, (columns,) [m]; nan as there.
    floor_m
        How far floor was seen, also where the picture ends before anything else, (columns,) [m];
        nan if that is not clear.
    """

    ranges_m: NDArray[np.float64]
    own_m: NDArray[np.float64]
    common_m: NDArray[np.float64]
    floor_m: NDArray[np.float64]


def column_ranges(
    strip: GroundStrip, boundary: Boundary, config: GroundCameraConfig
) -> ColumnRanges:
    """Return the distance to the lowest boundary of each column.

    To first order: with r = h / tan d, of the camera's height h and the depression d below the
    horizon, dr/dd = -(r^2 + h^2) / h and dr/dh = r / h.

    Parameters
    ----------
    strip
        Gives the ranges of rows.
    boundary
        The lowest boundary of each column.
    config
        The noise of boundary, pitch, calibration and height.
    """
    ranges, own, common = (np.full(len(boundary.rows), np.nan) for _ in range(3))
    found = np.flatnonzero(boundary.kinds == FOUND)
    rows, h = boundary.rows[found], strip.height_m
    r = ranges[found] = strip.ranges_at(rows)
    nearest = np.clip(np.rint(rows).astype(np.intp), 0, len(strip.depression_rad) - 2)
    row_rad = strip.depression_rad[nearest] - strip.depression_rad[nearest + 1]
    pixel_rows = strip.pixel_rows[nearest, found]
    noise_rows = np.hypot(config.boundary_sigma_px * pixel_rows, boundary.noise_rows[found])
    per_rad = (r**2 + h**2) / h
    own[found] = per_rad * noise_rows * row_rad
    angle_rad = math.radians(math.hypot(config.pitch_sigma_deg, config.calibration_sigma_deg))
    common[found] = np.hypot(per_rad * angle_rad, r * config.height_sigma)
    blocked = np.flatnonzero(boundary.kinds == BLOCKED)
    # It stands somewhere before the first floor that could be seen.
    ranges[blocked] = strip.ranges_m[strip.first_rows[blocked]]
    own[blocked], common[blocked] = ranges[blocked] / 3.0, 0.0
    ranges[boundary.kinds == FREE] = np.inf
    far = ranges > config.max_range_m
    ranges[far] = np.inf
    own[far] = common[far] = np.nan
    floor = np.where(boundary.kinds == UNSEEN, strip.floor_m, ranges)
    return ColumnRanges(ranges, own, common, floor)


def beam_scan(
    strip: GroundStrip, columns: ColumnRanges, stamp_ns: int, config: GroundCameraConfig
) -> RangeScan:
    """Return the columns as a fan of beams from the camera's foot point.

    Of the columns of a beam the nearest ones that see one thing are averaged: an obstacle at the
    side of a beam is never averaged away. A beam is free only if all its judged columns are.

    Parameters
    ----------
    strip
        Gives the bearings of columns and the foot point.
    columns
        Their ranges.
    stamp_ns
        Time of the picture [ns].
    config
        Number of beams and reach.
    """
    n = len(columns.ranges_m)
    edges = np.linspace(0, n, min(config.beams, n) + 1).astype(np.intp)
    angles, ranges, sigmas = (np.full(len(edges) - 1, np.nan) for _ in range(3))
    sigma = np.hypot(columns.own_m, columns.common_m)
    own = strip.bearings_rad, columns.ranges_m, sigma
    _beams(edges, *own, config.together_share, angles, ranges, sigmas)
    x_m, y_m = (float(value) for value in strip.camera.t_base_camera[:2])
    # Columns go from left to right, beams counter-clockwise.
    return RangeScan(
        stamp_ns,
        angles[::-1].copy(),
        ranges[::-1].copy(),
        config.max_range_m,
        x_m,
        y_m,
        sigmas[::-1].copy(),
    )


@compiled
def _beams(
    edges: NDArray[np.intp],
    bearings: NDArray[np.float64],
    ranges: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    together: float,
    beam_angles: NDArray[np.float64],
    beam_ranges: NDArray[np.float64],
    beam_sigmas: NDArray[np.float64],
) -> None:
    """Fill the beams from the columns between edges."""
    for k in range(len(beam_angles)):
        first, end = edges[k], edges[k + 1]
        beam_angles[k] = bearings[first:end].mean()
        judged, nearest = 0, np.inf
        for c in range(first, end):
            if not np.isnan(ranges[c]):
                judged += 1
                nearest = min(nearest, ranges[c])
        if 2 * judged <= end - first:
            continue
        if not nearest < np.inf:
            beam_ranges[k] = np.inf
            continue
        count, total, squares, sigma = 0, 0.0, 0.0, 0.0
        for c in range(first, end):
            if ranges[c] <= nearest * (1.0 + together):
                count += 1
                total += ranges[c]
                squares += ranges[c] ** 2
                sigma += sigmas[c]
        mean = total / count
        beam_ranges[k] = mean
        # One calibration and one pitch for all columns: averaging makes them no smaller.
        beam_sigmas[k] = np.hypot(sigma / count, np.sqrt(max(squares / count - mean**2, 0.0)))
