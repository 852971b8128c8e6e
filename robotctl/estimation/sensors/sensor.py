"""Measurements of a sensor for the localisers and the map."""

from __future__ import annotations

import enum
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.robust_kalman import Innovation
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import SensorMessage
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.measurement import RangeMeasurement
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap
from robotctl.model.world_map import WorldMap


class SensedRobot(NamedTuple):
    """Parts of the robot that its sensors depend on."""

    mounts: Sequence[SonarMount]
    """Its sonars, in the order of the ranges."""
    settings: LocalisationConfig
    has_camera: bool = False
    odometry: MotionNoise = MotionNoise()
    """Noise of its odometry."""


class Measured(Protocol):
    """Measurement of a sensor at one time."""

    @property
    def stamp_ns(self) -> int:
        """When that was."""


M = TypeVar("M", bound=Measured)
Listener: TypeAlias = Callable[[ControlState | SensorMessage], Sequence[M]]
"""Returns what is new in a message; raises ValueError if that is invalid."""
CellUpdate: TypeAlias = Callable[[OccupancyGrid, SE2], None]
"""Adds what was seen from a pose of `base` in `world` to the map."""


class Detail(enum.Enum):
    """Resolution of a sensor's drawing: a fine one starts the map again without the coarse ones."""

    FINE = enum.auto()
    MEDIUM = enum.auto()
    COARSE = enum.auto()


@dataclass(frozen=True, slots=True)
class Calibration:
    """How `robotctl characterise` reads a sensor's settings out of a recording.

    Parameters
    ----------
    beam_rad
        Opening of a beam by the settings [rad].
    measurements
        All that a recording has of it, in the order of the times, beams alike in all.
    readings
        Measurements that the localiser would take of a recording.
    """

    beam_rad: Callable[[LocalisationConfig], float]
    measurements: Callable[
        [Recording, Sequence[SonarMount], LocalisationConfig], Iterator[RangeMeasurement]
    ]
    readings: Callable[[Recording], Sequence[Measured]]


def _nothing(*_: object) -> Iterator[Any]:
    yield from ()


@dataclass(frozen=True, slots=True)
class Sensor(Generic[M]):
    """One kind of sensor.

    Parameters
    ----------
    listener
        Makes what decodes the messages of a robot; each listener hears each message once.
    likelihood
        Makes, for a map, what returns the log-likelihood of a measurement; raises ValueError if
        the map has no obstacle.
    rehearsal
        A measurement of no meaning, to compile what takes one; None if the robot has no such
        sensor.
    source
        Name for the particle filter, which weighs each source once per stretch of the path.
    innovations
        Corrects the EKF; nothing by default.
    cells
        Updates of the map, each with a key: it is made when the robot has moved since the last one
        of that key. Nothing by default.
    detail
        Resolution of its drawing of the map.
    calibration
        None: `robotctl characterise` does not know the sensor.
    """

    listener: Callable[[SensedRobot], Listener[M]]
    likelihood: Callable[[WorldMap, SensedRobot], Callable[[M], LogLikelihood]]
    rehearsal: Callable[[SensedRobot], M | None]
    source: Callable[[M], str]
    innovations: Callable[[PoseEkf, M, SensedRobot, WallMap], Iterator[Innovation | None]] = (
        _nothing
    )
    cells: Callable[[M, SensedRobot], Iterator[tuple[Hashable, CellUpdate]]] = _nothing
    detail: Detail = Detail.MEDIUM
    calibration: Calibration | None = None
