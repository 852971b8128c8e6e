"""Scans of a lidar: each is one as it comes; those of several lidars are joined."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.ranging.merging import ScanMerger
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.local_scans.source import ScanSource
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan
from robotctl.model.sensors.range_scan import RangeScan


class LidarScanSource:
    """Takes the scans of the lidars, as one view."""

    def __init__(self) -> None:
        self._merger = ScanMerger()

    def add(self, scan: RangeScan, odometry: SE2) -> list[RecordedScan]:
        """Return the view at a scan, unless another lidar makes it."""
        view = self._merger.add(scan, odometry)
        return [] if view is None else [RecordedScan(view, odometry)]


SOURCE: Final = ScanSource(
    KeyframeConfig(),
    lambda _: LidarScanSource(),
    lambda recording: [(each.scan, each.odometry) for each in recording.scans],
)
