"""Local scans of a camera, by the boundary of the floor in its pictures.

It sees little at once, a quarter of all directions and few metres, and what it sees shares the
errors of its mount and of the robot's pitch. So its echoes are gathered along the odometry.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.local_scans.gathered import GatheredScans
from robotctl.estimation.slam.local_scans.source import UNKNOWN_WHEELS, ScanSource
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan
from robotctl.model.sensors.range_scan import RangeScan

STRETCH_M: Final = 3.0
_STEP_M: Final = 0.1
"""Way between two pictures that count: neighbours see the same, with the same errors."""
_SURE_M: Final = 0.08
"""Ranges with a greater standard deviation are left out."""


class CameraScans:
    """Makes local scans of the ranges of a camera."""

    def __init__(self) -> None:
        self._gathered: GatheredScans | None = None
        self._next_m = 0.0

    def add(self, view: RangeScan, odometry: SE2) -> list[RecordedScan]:
        """Take a view in the order of time, with `base` in `odom` then; return new scans."""
        if self._gathered is None:
            self._gathered = GatheredScans(STRETCH_M, view.max_range_m)
        gathered = self._gathered
        gathered.move(view.stamp_ns, odometry)
        if gathered.way_m >= self._next_m:
            self._next_m = gathered.way_m + _STEP_M
            gathered.see(gathered.way_m, moved(odometry, _sure(view).points_base()))
        return gathered.take(gathered.way_m)


def _sure(view: RangeScan) -> RangeScan:
    """Return a view without the ranges that are vague."""
    if view.sigmas_m is None:
        return view
    return replace(view, ranges_m=np.where(view.sigmas_m < _SURE_M, view.ranges_m, np.nan))


def _maker(robot: SensedRobot) -> CameraScans:
    if not robot.has_camera:
        raise ValueError("no camera is mounted")
    return CameraScans()


SOURCE: Final = ScanSource(
    KeyframeConfig(keyframe_m=0.5, keyframe_rad=0.5, stretch_m=STRETCH_M, wheels=UNKNOWN_WHEELS),
    _maker,
    lambda recording: [(each.scan, each.odometry) for each in recording.views],
)
