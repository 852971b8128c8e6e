"""The sensors of the localisers; light enough for every process to read."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from robotctl.estimation.sensors.sensor import Sensor

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


def load_sensors() -> dict[str, Sensor[Any]]:
    """Return all sensors by their names, imported now."""
    return {name: import_module(module).SENSOR for name, module in SENSORS.items()}
