"""The boundary of the floor as a range scan, with what it is worth (notes, section 6.2)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera_boundary import BLOCKED, FOUND, FREE, Boundary
from robotctl.estimation.camera_config import GroundCameraConfig
from robotctl.estimation.camera_strip import GroundStrip
from robotctl.model.range_scan import RangeScan

_TOGETHER: Final = 0.1
"""Columns of one beam that differ by no more than this share of their range see one thing."""


def column_ranges(
    strip: GroundStrip, boundary: Boundary, config: GroundCameraConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the range of each column and its standard deviation.

    Parameters
    ----------
    strip
        Tells the ranges of rows.
    boundary
        The lowest boundary of each column.
    config
        The noise of boundary, pitch, calibration and height.

    Returns
    -------
    tuple
        Ranges (columns,) [m]: inf where nothing is in reach, nan where nothing was judged; standard
        deviations (columns,) [m], nan where there is no range.
    """
    ranges = np.full(len(boundary.rows), np.nan)
    sigmas = np.full(len(boundary.rows), np.nan)
    found = np.flatnonzero(boundary.kinds == FOUND)
    rows = boundary.rows[found]
    ranges[found] = strip.ranges_at(rows)
    sigmas[found] = range_sigmas(strip, rows, found, boundary.noise_rows[found], config)
    blocked = np.flatnonzero(boundary.kinds == BLOCKED)
    # It stands somewhere before the first floor that could be seen.
    ranges[blocked] = strip.ranges_m[strip.first_rows[blocked]]
    sigmas[blocked] = ranges[blocked] / 3.0
    ranges[boundary.kinds == FREE] = np.inf
    far = ranges > config.max_range_m
    ranges[far] = np.inf
    sigmas[far] = np.nan
    return ranges, sigmas


def range_sigmas(
    strip: GroundStrip,
    rows: NDArray[np.float64],
    columns: NDArray[np.intp],
    noise_rows: NDArray[np.float64],
    config: GroundCameraConfig,
) -> NDArray[np.float64]:
    """Return the standard deviation of ranges on the floor, to first order, (n,) [m].

    With r = h / tan d, of the camera's height h and the depression d below the horizon,
    dr/dd = -(r^2 + h^2) / h and dr/dh = r / h.
    """
    ranges = strip.ranges_at(rows)
    h = strip.height_m
    nearest = np.clip(np.rint(rows).astype(np.intp), 0, len(strip.depression_rad) - 2)
    row_rad = strip.depression_rad[nearest] - strip.depression_rad[nearest + 1]
    sigma_rows = np.hypot(config.boundary_sigma_px * strip.pixel_rows[nearest, columns], noise_rows)
    angle_rad = np.radians(math.hypot(config.pitch_sigma_deg, config.calibration_sigma_deg))
    sigma_rad = np.hypot(sigma_rows * row_rad, angle_rad)
    sigmas: NDArray[np.float64] = np.hypot(
        (ranges**2 + h**2) / h * sigma_rad, ranges * config.height_sigma
    )
    return sigmas


def beam_scan(
    strip: GroundStrip,
    ranges: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    stamp_ns: int,
    config: GroundCameraConfig,
) -> RangeScan:
    """Return the columns as a fan of beams from the camera's foot point.

    Of the columns of a beam the nearest ones that see one thing are averaged: an obstacle at the
    side of a beam is never averaged away. A beam is free only if all its judged columns are.

    Parameters
    ----------
    strip
        Tells the bearings of columns and the foot point.
    ranges, sigmas
        Of the columns, (columns,) [m].
    stamp_ns
        Time of the picture [ns].
    config
        Number of beams and reach.
    """
    groups = np.array_split(np.arange(len(ranges)), min(config.beams, len(ranges)))
    angles, beam_ranges, beam_sigmas = (np.full(len(groups), np.nan) for _ in range(3))
    for k, group in enumerate(groups):
        angles[k] = strip.bearings_rad[group].mean()
        r, s = ranges[group], sigmas[group]
        judged = r[~np.isnan(r)]
        if judged.size * 2 <= r.size:
            continue
        nearest = judged.min()
        beam_ranges[k] = nearest
        if math.isinf(nearest):
            continue
        same = r <= nearest * (1.0 + _TOGETHER)
        beam_ranges[k] = r[same].mean()
        # One calibration and one pitch for all columns: averaging makes them no smaller.
        beam_sigmas[k] = math.hypot(s[same].mean(), float(r[same].std()))
    x_m, y_m = (float(value) for value in strip.camera.t_base_camera[:2])
    order = np.argsort(angles)
    return RangeScan(
        stamp_ns,
        angles[order],
        beam_ranges[order],
        config.max_range_m,
        x_m,
        y_m,
        beam_sigmas[order],
    )
