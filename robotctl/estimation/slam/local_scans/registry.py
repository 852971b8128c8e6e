"""The sensors that SLAM can work with; light enough for every process to read."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from robotctl.estimation.sensor_names import CAMERA, LIDAR, SONAR

if TYPE_CHECKING:
    from robotctl.estimation.slam.local_scans.source import ScanSource

SCAN_SOURCES: Final[dict[str, str]] = {
    LIDAR: "robotctl.estimation.slam.local_scans.lidar",
    SONAR: "robotctl.estimation.slam.local_scans.sonar",
    CAMERA: "robotctl.estimation.slam.local_scans.camera",
}
"""Modules whose `SOURCE` is the source, by the sensor's name; the first that a robot has counts."""


def load_source(sensor: str) -> ScanSource[Any]:
    """Return the source of a sensor, imported now."""
    source: ScanSource[Any] = import_module(SCAN_SOURCES[sensor]).SOURCE
    return source
