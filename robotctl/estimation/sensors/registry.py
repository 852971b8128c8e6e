"""The sensors of the localisers; light enough for every process to read."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from robotctl.estimation.sensor_names import SENSORS

if TYPE_CHECKING:
    from robotctl.estimation.sensors.sensor import Sensor


def load_sensors() -> dict[str, Sensor[Any]]:
    """Return all sensors by their names, imported now."""
    return {name: import_module(module).SENSOR for name, module in SENSORS.items()}
