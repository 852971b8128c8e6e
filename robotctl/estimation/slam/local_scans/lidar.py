"""Scans of a lidar: each is one as it comes."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.local_scans.source import ScanSource
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan
from robotctl.model.sensors.range_scan import RangeScan


class LidarScanSource:
    """Takes the scans of a lidar as they are."""

    def add(self, scan: RangeScan, odometry: SE2) -> list[RecordedScan]:
        """Return the scan."""
        return [RecordedScan(scan, odometry)]


SOURCE: Final = ScanSource(
    KeyframeConfig(),
    lambda _: LidarScanSource(),
    lambda recording: [(each.scan, each.odometry) for each in recording.scans],
)
