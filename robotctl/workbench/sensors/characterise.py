"""`robotctl characterise`: what a robot's sonars or lidar are like, from readings at known poses.

The source is a log, or, without one, the simulated robot. See `docs/sensors.md`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.app.localisation.map_sensors import MapSensors
from robotctl.config.patch import round_figures
from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.errors import CalibrationError
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.fit.expected_ranges import EchoExpectations
from robotctl.estimation.ranging.fit.sensor_fit import SensorFit, fit_sensor, reach_m
from robotctl.estimation.sensor_names import LIDAR, SONAR
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.words import counted
from robotctl.workbench.sensors.options import CharacteriseOptions
from robotctl.workbench.sensors.sources import (
    CALIBRATIONS,
    Progress,
    Source,
    simulated_drive,
    source_of_log,
    taken,
)

PARTICLE_SPREAD_M: Final = 0.05
"""Typical distance of particles from the truth: even the best is off by this."""

_CHECKED: Final = 400
"""Maximum number of readings that judge the new settings."""
_PLACES: Final = ((64, (0.05, 0.05, 0.03)), (256, (0.5, 0.5, 0.3)))
"""Number and standard deviations of poses beside the true one: near and far [m, m, rad]."""
_LEAST: Final = 0.01
_MOST: Final = 0.45
_NAMES: Final = {"short_per_m": "rate of short readings"}


@dataclass(frozen=True, slots=True, eq=False)
class Characterisation:
    """The result.

    Parameters
    ----------
    options, config
        What was asked for, and the robot as it is.
    source
        Where the readings come from.
    fit
        Their results.
    patched
        The settings of the localiser with what was found.
    within
        Share of ranges away from edges that lie within three standard deviations, by the present
        settings, of what they should be; 0.997 would be right for a sensor without outliers.
    told_before, told_after
        How well a reading distinguishes the true place from others nearby, with the present
        settings and with those found: see `told` [nat].
    """

    options: CharacteriseOptions
    config: RobotConfig
    source: Source
    fit: SensorFit
    patched: LocalisationConfig
    within: float
    told_before: float
    told_after: float

    @property
    def hidden(self) -> list[str]:
        """Text on what the data do not determine."""
        named = [(_NAMES.get(key, key), value) for key, value in self.fit.ranges.values.items()]
        named.append(("max_incidence_deg", self.fit.incidence.limit))
        if self.source.sensor == SONAR:
            named.append(("max_range_m", self.fit.greatest_m))
        return [f"{name}: {value.why_not}" for name, value in named if value.why_not]


def characterise(
    options: CharacteriseOptions, progress: Progress = lambda _line: None
) -> Characterisation:
    """Gather readings, fit, and test the result for the localiser on them.

    Raises
    ------
    ConfigError
        If the robot, a setting, the map or an option is wrong.
    LogFormatError
        If the log cannot be read.
    CalibrationError
        If the data are too few, or their poses are not known.
    SimulatorError
        If the robot cannot be simulated.
    """
    config = load_robot(options.robot, options.overrides)
    source = _source(options, config, progress)
    have = taken(source, config)
    room = source.world_map.walls or source.world_map.grid
    progress(f"fitting {counted(len(have.readings.ranges_m), 'reading')}")
    try:
        expectations = EchoExpectations(room, have.mounts, have.beam_rad, reach_m(have.readings))
        fit = fit_sensor(expectations, have.readings)
    except ValueError as error:
        raise CalibrationError(f"{source.recording.name}: {error}") from error
    patched = patched_settings(fit, source.sensor, config.localisation)
    progress("trying the new settings")
    nats = []
    for settings in (config.localisation, patched):
        sensors = MapSensors(source.world_map, SensedRobot(source.mounts, settings))
        nats.append(told(source, sensors, config.odometry))
    within = fit.within(have.sigmas_m)
    return Characterisation(options, config, source, fit, patched, within, *nats)


def _source(options: CharacteriseOptions, config: RobotConfig, progress: Progress) -> Source:
    """Read the log, or record a simulated drive and read that."""
    if options.log is not None:
        progress(f"reading {options.log}")
        return source_of_log(
            options.log,
            options.map,
            options.sensor,
            config,
            max_range_m=options.max_range_m,
            time_unit=options.time_unit,
        )
    with TemporaryDirectory() as folder:
        world = simulated_drive(
            options.robot,
            options.overrides,
            options.seed,
            options.map,
            options.sensor,
            Path(folder),
            progress,
        )
        return source_of_log(Path(folder), world, options.sensor, config)


def patched_settings(
    fit: SensorFit, sensor: str, present: LocalisationConfig
) -> LocalisationConfig:
    """Return the settings of the localiser that follow from a fit.

    Undetermined values are kept. Deviations are widened by the spread of particles. A filter that
    trusts too much loses the robot, so probabilities are the upper ends of their intervals, and
    outliers at least the share of all readings, edges included, that is off by far.
    """
    values, mixture = fit.ranges.values, fit.ranges.mixture
    typical_m = fit.ranges.typical_m
    typical_sigma_m = float(mixture.sigma_at(np.array(typical_m)))
    wide_m = math.hypot(typical_sigma_m, PARTICLE_SPREAD_M)
    garbage = min(max(values["garbage"].high, fit.off_share(wide_m), _LEAST), _MOST)
    none = min(max(values["none"].high, _LEAST), _MOST)
    if sensor == LIDAR:
        as_used = replace(
            mixture,
            hit=1.0 - garbage - none,
            short=0.5 * garbage,
            random=0.5 * garbage,
            none=none,
            sigma_m=wide_m,
            sigma_per_m=0.0,
        )
        k = round_figures(as_used.robust_k(typical_m, fit.greatest_m.value), 2)
        lidar = replace(present.lidar, sigma_m=round_figures(wide_m, 2), robust_k=k)
        return replace(present, lidar=lidar)
    sigma_m = math.hypot(mixture.sigma_m, PARTICLE_SPREAD_M)
    found = {"sigma_m": sigma_m, "random": garbage, "none": none}
    if not values["sigma_per_m"].why_not:
        found["sigma_per_m"] = mixture.sigma_per_m
    if not fit.incidence.limit.why_not:
        found["max_incidence_deg"] = math.degrees(fit.incidence.limit.value)
    if not fit.greatest_m.why_not:
        found["max_range_m"] = fit.greatest_m.value
    sonar = replace(present.sonar, **{key: round_figures(v, 3) for key, v in found.items()})
    grid = replace(present.grid, sonar_band_m=round_figures(wide_m, 2))
    return replace(present, sonar=sonar, grid=grid)


def told(source: Source, sensors: MapSensors, noise: MotionNoise) -> float:
    """Return how well a reading distinguishes the true place from others, on average [nat].

    The log of how many times likelier a reading is within centimetres of the true pose, where
    particles are, than at places within decimetres of it.

    Raises
    ------
    CalibrationError
        If no reading can be judged, since no pose is known.
    """
    rng = np.random.default_rng(1)
    near, far = (rng.normal(size=(n, 3)) * spread for n, spread in _PLACES)
    logs = []
    readings = CALIBRATIONS[source.sensor].readings(source.recording)
    for reading in readings[:: max(1, -(-len(readings) // _CHECKED))]:
        pose = source.pose_at(reading.stamp_ns, noise)
        if pose is None:
            continue
        at = np.array([pose.x_m, pose.y_m, pose.theta_rad])
        measurement = sensors.measurement(source.sensor, reading)
        likelihoods = measurement(at + np.concatenate([near, far]))
        logs.append(_log_mean(likelihoods[: len(near)]) - _log_mean(likelihoods[len(near) :]))
    if not logs:
        raise CalibrationError(
            f"{source.recording.name}: {source.poses_by} gives no pose for any reading that would "
            "judge the new settings"
        )
    return float(np.mean(logs))


def _log_mean(logs: NDArray[np.float64]) -> float:
    """Return the log of the mean of likelihoods."""
    greatest = float(logs.max())
    return greatest + math.log(float(np.mean(np.exp(logs - greatest))))
