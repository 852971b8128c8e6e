"""Echoes of the robot itself in the scans of its lidars."""

from __future__ import annotations

import msgspec
import numpy as np

from robotctl.estimation.ranging.scan_messages import lidar_scan
from robotctl.messages.estimation import LidarScan
from robotctl.model.footprint_arrays import Sides, covers

NEAR_M = 0.03
"""Distance from the body within which an echo is of the body [m]: outlines are drawn by hand."""


def without_body(message: LidarScan, body: Sides) -> LidarScan:
    """Return a scan in which echoes of the body are no readings (nan).

    Parameters
    ----------
    message
        As it was measured; one that is no scan is returned as it is.
    body
        Its sides, as `side_rows` gives them.
    """
    try:
        scan = lidar_scan(message)
    except ValueError:
        return message
    reach = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, np.nan)[:, np.newaxis]
    beams = np.column_stack([np.cos(scan.angles_rad), np.sin(scan.angles_rad)])
    own = covers(body, (scan.x_m, scan.y_m) + reach * beams, NEAR_M)
    if not own.any():
        return message
    ranges = np.where(own, np.nan, scan.ranges_m).astype("<f4").tobytes()
    return msgspec.structs.replace(message, ranges=ranges)
