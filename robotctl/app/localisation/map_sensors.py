"""Likelihoods of measurements on one map, for live and recorded data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.sensors.registry import load_sensors
from robotctl.estimation.sensors.sensor import Measured, SensedRobot
from robotctl.model.world_map import WorldMap


class MapSensors:
    """Makes measurements for the particle filter; each sensor's model when it is first needed.

    Parameters
    ----------
    world_map
        The map; sonars go by its walls where it has some.
    robot
        The robot as its sensors need to know it.
    """

    def __init__(self, world_map: WorldMap, robot: SensedRobot) -> None:
        self._map = world_map
        self._robot = robot
        self._sensors = load_sensors()
        self._likelihoods: dict[str, Callable[[Any], LogLikelihood]] = {}

    def source(self, sensor: str, measured: Measured) -> str:
        """Return the name of a measurement's source for the particle filter."""
        return self._sensors[sensor].source(measured)

    def measurement(self, sensor: str, measured: Measured) -> LogLikelihood:
        """Return the log-likelihood of what a sensor measured.

        Raises
        ------
        ValueError
            If the map has no obstacle.
        """
        if sensor not in self._likelihoods:
            self._likelihoods[sensor] = self._sensors[sensor].likelihood(self._map, self._robot)
        return self._likelihoods[sensor](measured)

    def rehearsal(self) -> list[LogLikelihood]:
        """Return a measurement of no meaning of each sensor, to compile the functions for it."""
        made = ((name, each.rehearsal(self._robot)) for name, each in self._sensors.items())
        return [self.measurement(name, measured) for name, measured in made if measured is not None]
