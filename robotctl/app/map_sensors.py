"""What scans and sonars say of places on one map, live and on recorded logs alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from robotctl.app.localisation_map import LocalisationMap
from robotctl.estimation.likelihood_config import LikelihoodFieldConfig
from robotctl.estimation.likelihood_field import LikelihoodField
from robotctl.estimation.log_likelihood import LogLikelihood
from robotctl.estimation.sonar_config import SonarModelConfig
from robotctl.estimation.sonar_model import SonarModel
from robotctl.model.range_scan import RangeScan
from robotctl.model.sonar import SonarMount, SonarReading

LIDAR: Final = "lidar"
"""Name of the sensor for the particle filter."""


class MapSensors:
    """Makes measurements for the particle filter.

    Parameters
    ----------
    chart
        The map; sonars go by its walls where it has some.
    mounts
        Where the sonars sit; may be empty.
    lidar, sonar
        What is known of the sensors.

    Raises
    ------
    ValueError
        If the map has no obstacle.
    """

    def __init__(
        self,
        chart: LocalisationMap,
        mounts: Sequence[SonarMount],
        lidar: LikelihoodFieldConfig,
        sonar: SonarModelConfig,
    ) -> None:
        self._field = LikelihoodField(chart.grid, lidar)
        room = chart.grid if chart.walls is None else chart.walls
        self._sonars = SonarModel(room, mounts, sonar)
        self._count = len(mounts)

    def scan(self, scan: RangeScan) -> LogLikelihood:
        """Return what a scan says of poses."""
        return self._field.measurement(scan)

    def sonar(self, reading: SonarReading) -> LogLikelihood:
        """Return what a reading of sonars says of poses."""
        return self._sonars.measurement(np.array(reading.ranges_m))

    def rehearsal(self) -> list[LogLikelihood]:
        """Return a measurement of no meaning by the sonars, to compile what it takes."""
        return [self._sonars.measurement(np.full(self._count, 1.5))] if self._count else []


def sonar_name(reading: SonarReading) -> str:
    """Return the name of a group of sonars for the particle filter."""
    return f"sonar {reading.first}"
