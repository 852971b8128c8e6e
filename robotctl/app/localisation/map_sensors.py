"""Likelihoods of scans and sonars on one map, for live and recorded data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.sonar_model import SonarModel
from robotctl.maps.localisation_map import LocalisationMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount, SonarReading

LIDAR: Final = "lidar"
CAMERA: Final = "camera"
SONAR: Final = "sonar"
"""Names of the sensors for the particle filter."""

_SCAN: Final = RangeScan(0, np.linspace(-1.0, 1.0, 21), np.full(21, 2.0), 10.0)
"""Of no meaning, for rehearsals."""
_VAGUE_M: Final = 0.5
"""Ranges of a camera are seldom less sure [m]."""


class MapSensors:
    """Makes measurements for the particle filter.

    Parameters
    ----------
    world_map
        The map; sonars go by its walls where it has some.
    mounts
        Mounting of the sonars; may be empty.
    settings
        What is known of the sensors.

    Raises
    ------
    ValueError
        If the map has no obstacle.
    """

    def __init__(
        self, world_map: LocalisationMap, mounts: Sequence[SonarMount], settings: LocalisationConfig
    ) -> None:
        self._grid = world_map.grid
        self._settings = settings
        self._field = LikelihoodField(world_map.grid, settings.lidar)
        room = world_map.grid if world_map.walls is None else world_map.walls
        self._sonars = SonarModel(room, mounts, settings.sonar)
        self._count = len(mounts)

    def scan(self, scan: RangeScan) -> LogLikelihood:
        """Return the log-likelihood of a lidar scan."""
        return self._field.measurement(scan)

    def view(self, scan: RangeScan) -> LogLikelihood:
        """Return what the ranges that a camera sees say of poses."""
        return self._camera_field.measurement(scan)

    def sonar(self, reading: SonarReading) -> LogLikelihood:
        """Return the log-likelihood of a sonar reading."""
        return self._sonars.measurement(np.array(reading.ranges_m))

    def rehearsal(self, *, camera: bool) -> list[LogLikelihood]:
        """Return a dummy measurement of each sensor, to compile the functions for it."""
        measurements = [self.scan(_SCAN)]
        if camera:
            # Vague ranges, so that the fields for them are made now.
            sigmas = np.full(len(_SCAN.ranges_m), _VAGUE_M)
            measurements.append(self.view(replace(_SCAN, sigmas_m=sigmas)))
        if self._count:
            measurements.append(self._sonars.measurement(np.full(self._count, 1.5)))
        return measurements

    @cached_property
    def _camera_field(self) -> LikelihoodField:
        return LikelihoodField(self._grid, self._settings.camera)


def sonar_name(reading: SonarReading) -> str:
    """Return the name of a group of sonars for the particle filter."""
    return f"{SONAR} {reading.first}"
