"""The lidar: scans in a plane, from a process of its own or from the simulator."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Final

import numpy as np

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.beam_selection import evenly_chosen
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.scan_messages import lidar_scan
from robotctl.estimation.sensor_names import LIDAR
from robotctl.estimation.sensors.sensor import (
    Calibration,
    CellUpdate,
    Detail,
    Listener,
    SensedRobot,
    Sensor,
)
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LidarScan, SensorMessage
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.measurement import RangeMeasurement
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.world_map import WorldMap

_BEAMS: Final = 24
"""Beams used of each scan, evenly spaced: neighbours have correlated errors."""
_BEAM_RAD: Final = math.radians(0.1)
"""Opening of a beam [rad], next to nothing."""

REHEARSED: Final = RangeScan(0, np.linspace(-1.0, 1.0, 21), np.full(21, 2.0), 10.0)


def _listen(message: ControlState | SensorMessage) -> Sequence[RangeScan]:
    return (lidar_scan(message),) if isinstance(message, LidarScan) else ()


def _listener(_: SensedRobot) -> Listener[RangeScan]:
    return _listen


def _likelihood(world_map: WorldMap, robot: SensedRobot) -> Callable[[RangeScan], LogLikelihood]:
    return LikelihoodField(world_map.grid, robot.settings.lidar).measurement


def _cells(scan: RangeScan, _: SensedRobot) -> Iterator[tuple[Hashable, CellUpdate]]:
    for each in scan.parts:
        yield lidar_source(each), scan_update(each)


def lidar_source(scan: RangeScan) -> str:
    """Return the name of a scan's lidar for the particle filter."""
    return f"{LIDAR} {scan.name}" if scan.name else LIDAR


def scan_update(scan: RangeScan) -> CellUpdate:
    """Return the update of a map by a scan."""

    def update(grid: OccupancyGrid, pose: SE2) -> None:
        grid.update_scan(pose, scan)

    return update


def _measurements(
    recording: Recording, _mounts: Sequence[SonarMount], settings: LocalisationConfig
) -> Iterator[RangeMeasurement]:
    first = recording.scans[0].scan
    chosen = evenly_chosen(np.ones(len(first.ranges_m), np.bool_), _BEAMS)
    beams = np.full((len(chosen), 3), (first.x_m, first.y_m, 0.0))
    beams[:, 2] = first.angles_rad[chosen]
    sigmas = np.full(len(chosen), settings.lidar.sigma_m)
    for scan in _readings(recording):
        if _same_beams(scan, first):
            ranges = scan.ranges_m[chosen]
            ranges = np.where(ranges < first.max_range_m, ranges, ranges + math.inf)
            yield RangeMeasurement(scan.stamp_ns, beams, ranges, sigmas, first.max_range_m)


def _same_beams(scan: RangeScan, first: RangeScan) -> bool:
    """Whether two scans are of one sensor."""
    return (
        (scan.x_m, scan.y_m, scan.max_range_m) == (first.x_m, first.y_m, first.max_range_m)
        and scan.angles_rad.shape == first.angles_rad.shape
        and bool(np.allclose(scan.angles_rad, first.angles_rad))
    )


def _readings(recording: Recording) -> Sequence[RangeScan]:
    return [entry.scan for entry in recording.scans]


SENSOR: Final = Sensor(
    _listener,
    _likelihood,
    lambda _: REHEARSED,
    lidar_source,
    cells=_cells,
    detail=Detail.FINE,
    calibration=Calibration(lambda _: _BEAM_RAD, _measurements, _readings),
)
