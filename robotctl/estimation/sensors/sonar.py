"""The sonars: cones that the control process hears."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Final

import numpy as np

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.robust_kalman import Innovation
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.ranging.sonar_model import SonarModel
from robotctl.estimation.sensor_names import SONAR
from robotctl.estimation.sensors.sensor import (
    Calibration,
    CellUpdate,
    Detail,
    Listener,
    SensedRobot,
    Sensor,
)
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import SensorMessage
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.measurement import RangeMeasurement
from robotctl.model.sensors.new_sonar_readings import NewSonarReadings
from robotctl.model.sensors.sonar import SonarMount, SonarReading
from robotctl.model.sensors.sonar_mounts import mount_rows
from robotctl.model.wall_map import WallMap
from robotctl.model.world_map import WorldMap


def _listener(robot: SensedRobot) -> Listener[SonarReading]:
    news = NewSonarReadings(robot.settings.sonar.max_range_m)

    def listen(message: ControlState | SensorMessage) -> Sequence[SonarReading]:
        if not isinstance(message, ControlState):
            return ()
        return news.take(message.stamp_ns, message.sonar_stamp_ns, message.sonar_m)

    return listen


def _likelihood(world_map: WorldMap, robot: SensedRobot) -> Callable[[SonarReading], LogLikelihood]:
    room = world_map.grid if world_map.walls is None else world_map.walls
    model = SonarModel(room, robot.mounts, robot.settings.sonar)
    return lambda reading: model.measurement(np.array(reading.ranges_m))


def _rehearsal(robot: SensedRobot) -> SonarReading | None:
    return SonarReading(0, (1.5,) * len(robot.mounts)) if robot.mounts else None


def _source(reading: SonarReading) -> str:
    return f"{SONAR} {reading.first}"


def _innovations(
    ekf: PoseEkf, reading: SonarReading, robot: SensedRobot, walls: WallMap
) -> Iterator[Innovation | None]:
    for mount, range_m in zip(robot.mounts, reading.ranges_m, strict=True):
        yield ekf.update_sonar(reading.stamp_ns, mount, range_m, walls)


def _cells(reading: SonarReading, robot: SensedRobot) -> Iterator[tuple[Hashable, CellUpdate]]:
    for index, (range_m, mount) in enumerate(zip(reading.ranges_m, robot.mounts, strict=True)):
        if not math.isnan(range_m):
            yield (SONAR, index), _cell(mount, range_m)


def _cell(mount: SonarMount, range_m: float) -> CellUpdate:
    def update(grid: OccupancyGrid, pose: SE2) -> None:
        grid.update_sonar(pose, mount, range_m)

    return update


def _beam_rad(settings: LocalisationConfig) -> float:
    return math.radians(settings.sonar.beam_deg)


def _measurements(
    recording: Recording, mounts: Sequence[SonarMount], settings: LocalisationConfig
) -> Iterator[RangeMeasurement]:
    beams = mount_rows(mounts)
    sonar = settings.sonar
    for entry in recording.sonars:
        ranges = np.array(entry.reading.ranges_m)
        sigmas = sonar.sigma_m + sonar.sigma_per_m * np.where(np.isfinite(ranges), ranges, 0.0)
        yield RangeMeasurement(entry.reading.stamp_ns, beams, ranges, sigmas)


def _readings(recording: Recording) -> Sequence[SonarReading]:
    return [entry.reading for entry in recording.sonars]


SENSOR: Final = Sensor(
    _listener,
    _likelihood,
    _rehearsal,
    _source,
    innovations=_innovations,
    cells=_cells,
    # Where a lidar draws, cones only blur what it sees.
    detail=Detail.COARSE,
    calibration=Calibration(_beam_rad, _measurements, _readings),
)
