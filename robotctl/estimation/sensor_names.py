"""Names of the sensors of the localisers; light enough for every process to read."""

from __future__ import annotations

from typing import Final

LIDAR: Final = "lidar"
CAMERA: Final = "camera"
SONAR: Final = "sonar"

SENSORS: Final[dict[str, str]] = {
    LIDAR: "robotctl.estimation.sensors.lidar",
    CAMERA: "robotctl.estimation.sensors.camera",
    SONAR: "robotctl.estimation.sensors.sonar",
}
"""Modules whose `SENSOR` is the sensor, by its name in `localisation.sensors`; in the order in
which the map takes them."""
