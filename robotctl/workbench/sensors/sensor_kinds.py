"""The kinds of sensors: from their settings and recordings to typed measurements and likelihoods.

A registry: who works with sensors of any kind looks the kind up by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.app.localisation.map_sensors import LIDAR, SONAR, MapSensors
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.odometry.estimate import arc_between
from robotctl.estimation.ranging.beam_selection import evenly_chosen
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.measurement import MotionMeasurement, RangeMeasurement
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.sensors.sonar_mounts import mount_rows
from robotctl.model.trajectory import Trajectory

_BEAMS: Final = 24
"""Beams used of each scan, evenly spaced: neighbours have correlated errors."""
_LIDAR_BEAM_RAD: Final = math.radians(0.1)

Mounts = Sequence[SonarMount]


@dataclass(frozen=True, slots=True)
class SensorKind:
    """One kind of sensor that measures ranges.

    Parameters
    ----------
    beam_rad
        Opening of a beam by the settings [rad].
    measurements
        All that a recording has of it, in the order of the times, beams alike in all.
    likelihoods
        Time and likelihood of some of these by the sensor models of a map, evenly; at most so
        many.
    """

    beam_rad: Callable[[LocalisationConfig], float]
    measurements: Callable[[Recording, Mounts, LocalisationConfig], Iterator[RangeMeasurement]]
    likelihoods: Callable[[Recording, MapSensors, int], Iterator[tuple[int, LogLikelihood]]]


def motion_between(
    odometry: Trajectory, begin_ns: int, end_ns: int, noise: MotionNoise
) -> MotionMeasurement | None:
    """Return the wheels' motion between two times; None if there is no odometry."""
    begin, end = odometry.at(begin_ns), odometry.at(end_ns)
    if begin is None or end is None:
        return None
    motion = begin.inverse() @ end
    covariance = added_covariance(SE2(), *arc_between(motion), noise)
    return MotionMeasurement(begin_ns, end_ns, motion, covariance)


def _sonar_beam_rad(settings: LocalisationConfig) -> float:
    return math.radians(settings.sonar.beam_deg)


def _sonar_measurements(
    recording: Recording, mounts: Mounts, settings: LocalisationConfig
) -> Iterator[RangeMeasurement]:
    beams = mount_rows(mounts)
    sonar = settings.sonar
    for entry in recording.sonars:
        ranges = np.array(entry.reading.ranges_m)
        sigmas = sonar.sigma_m + sonar.sigma_per_m * np.where(np.isfinite(ranges), ranges, 0.0)
        yield RangeMeasurement(entry.reading.stamp_ns, beams, ranges, sigmas)


def _sonar_likelihoods(
    recording: Recording, sensors: MapSensors, most: int
) -> Iterator[tuple[int, LogLikelihood]]:
    for entry in recording.sonars[:: _step(len(recording.sonars), most)]:
        yield entry.reading.stamp_ns, sensors.sonar(entry.reading)


def _lidar_beam_rad(_settings: LocalisationConfig) -> float:
    return _LIDAR_BEAM_RAD


def _lidar_measurements(
    recording: Recording, _mounts: Mounts, settings: LocalisationConfig
) -> Iterator[RangeMeasurement]:
    first = recording.scans[0].scan
    chosen = evenly_chosen(np.ones(len(first.ranges_m), np.bool_), _BEAMS)
    beams = np.full((len(chosen), 3), (first.x_m, first.y_m, 0.0))
    beams[:, 2] = first.angles_rad[chosen]
    sigmas = np.full(len(chosen), settings.lidar.sigma_m)
    for entry in recording.scans:
        if _same_beams(entry.scan, first):
            ranges = entry.scan.ranges_m[chosen]
            ranges = np.where(ranges < first.max_range_m, ranges, ranges + math.inf)
            stamp_ns = entry.scan.stamp_ns
            yield RangeMeasurement(stamp_ns, beams, ranges, sigmas, first.max_range_m)


def _lidar_likelihoods(
    recording: Recording, sensors: MapSensors, most: int
) -> Iterator[tuple[int, LogLikelihood]]:
    for entry in recording.scans[:: _step(len(recording.scans), most)]:
        yield entry.scan.stamp_ns, sensors.scan(entry.scan)


def _same_beams(scan: RangeScan, first: RangeScan) -> bool:
    """Whether two scans are of one sensor."""
    return (
        (scan.x_m, scan.y_m, scan.max_range_m) == (first.x_m, first.y_m, first.max_range_m)
        and scan.angles_rad.shape == first.angles_rad.shape
        and bool(np.allclose(scan.angles_rad, first.angles_rad))
    )


def _step(count: int, most: int) -> int:
    """Return each how-many-th of `count` is to be taken for at most about `most`."""
    return max(1, -(-count // most))


SENSOR_KINDS: Final = {
    SONAR: SensorKind(_sonar_beam_rad, _sonar_measurements, _sonar_likelihoods),
    LIDAR: SensorKind(_lidar_beam_rad, _lidar_measurements, _lidar_likelihoods),
}
"""By the names that the particle filter has for them too."""
