"""Scans of lidar and camera between messages and values."""

from __future__ import annotations

import numpy as np

from robotctl.messages.estimation import CameraView, LidarScan
from robotctl.model.sensors.range_scan import RangeScan


def lidar_scan(message: LidarScan) -> RangeScan:
    """Return the scan of a lidar's message; raises ValueError if invalid."""
    ranges = np.frombuffer(message.ranges, np.dtype("<f4")).astype(np.float64)
    angles = message.first_rad + message.step_rad * np.arange(len(ranges), dtype=np.float64)
    return RangeScan(
        message.stamp_ns,
        angles,
        ranges,
        message.max_range_m,
        message.x_m,
        message.y_m,
        name=message.name,
        sweep_s=message.sweep_s,
    )


def camera_scan(message: CameraView) -> RangeScan:
    """Return the scan in a view of the camera; raises ValueError if invalid."""
    return RangeScan(
        message.stamp_ns,
        np.array(message.angles_rad, dtype=np.float64),
        np.array(message.ranges_m, dtype=np.float64),
        message.max_range_m,
        message.x_m,
        message.y_m,
        np.array(message.sigmas_m, dtype=np.float64),
    )
