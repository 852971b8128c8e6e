"""Readings at known poses in a known room, from recordings and simulated drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import RobotConfig, find_file
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.odometry.estimate import arc_between
from robotctl.estimation.ranging.fit.expected_ranges import Sightlines
from robotctl.estimation.ranging.fit.sensor_fit import Readings
from robotctl.estimation.sensor_names import LIDAR, SONAR
from robotctl.estimation.sensors.registry import load_sensors
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.times import is_timeless
from robotctl.logs.log_poses import best_poses
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.model.drives.motion_noise import added_covariance
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.sensors.measurement import MotionMeasurement
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.trajectory import Trajectory
from robotctl.model.world_map import WorldMap
from robotctl.workbench.localise.mapping import choose_scans

Progress: TypeAlias = Callable[[str], None]

CALIBRATIONS: Final = {
    name: each.calibration for name, each in load_sensors().items() if each.calibration is not None
}
MISSION: Final = "patrol"
"""Mission of the simulated robot."""

_TELL_EVERY_NS: Final = 20_000_000_000
_DENSE_NS: Final = 100_000_000
"""Maximum interval between poses within which the robot moves evenly [ns]."""
_SURE: Final = (0.02, 0.02, 0.02)
"""Maximum standard deviations that odometry adds to a pose [m, m, rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Readings of one kind of sensor, and the poses where they were taken.

    Parameters
    ----------
    sensor
        `sonar` or `lidar`.
    recording
        The drive; only the scans that were used.
    poses
        `base` in `world` over time.
    world_map
        The room.
    mounts
        The sonars.
    poses_by, map_by
        As text: the source of poses and map.
    notes
        Sentences for people.
    """

    sensor: str
    recording: Recording
    poses: Trajectory
    world_map: WorldMap
    mounts: tuple[SonarMount, ...]
    poses_by: str
    map_by: str
    notes: tuple[str, ...] = ()

    def pose_at(self, stamp_ns: int, noise: MotionNoise) -> SE2 | None:
        """Return `base` in `world` at a time; None if it is not known well enough.

        Between poses far apart in time, odometry gives the motion.
        """
        stamps_ns, odometry = self.poses.stamps_ns, self.recording.odometry
        after = int(np.searchsorted(stamps_ns, stamp_ns))
        if not 0 < after < len(stamps_ns) or odometry is None:
            return self.poses.at(stamp_ns)
        begin_ns = int(stamps_ns[after - 1])
        if stamps_ns[after] in (stamp_ns, begin_ns) or stamps_ns[after] - begin_ns <= _DENSE_NS:
            return self.poses.at(stamp_ns)
        moved = motion_between(odometry, begin_ns, stamp_ns, noise)
        begin = self.poses.at(begin_ns)
        if moved is None or begin is None:
            return None
        sigmas = np.sqrt(np.diag(moved.covariance))
        return begin @ moved.motion if np.all(sigmas <= _SURE) else None


def source_of_log(
    log: Path,
    map_name: str,
    sensor: str,
    config: RobotConfig,
    *,
    max_range_m: float | None = None,
    time_unit: str | None = None,
) -> Source:
    """Read a log, and the map or make it of the log's own even scans.

    For `max_range_m` and `time_unit` see `read_recording`.

    Raises
    ------
    ConfigError
        If the map is wrong or missing.
    LogFormatError
        If the log cannot be read.
    CalibrationError
        If the log has no such readings or no poses.
    """
    recording = read_recording(log, max_range_m=max_range_m, time_unit=time_unit)
    if is_timeless(np.array([entry.scan.stamp_ns for entry in recording.scans])):
        raise CalibrationError(f"{log}: all scans in it have one time, so their poses are unknown")
    sensor = sensor or (SONAR if recording.sonars else LIDAR)
    what, readings = _readings(sensor, recording)
    if not readings:
        raise CalibrationError(f"{log}: no {what} of use in it{_has(recording)}{recording.why()}")
    found = best_poses(log, recording)
    if found is None:
        raise CalibrationError(
            f"{log}: neither reference poses nor those of a localiser in it, so the poses of the "
            "readings are unknown; record with a localiser: robotctl run --record, or in "
            "simulation"
        )
    poses, poses_by = found
    notes = list(recording.notes)
    mounts = recording.sonar_mounts
    if sensor == SONAR and not mounts:
        mounts = _mounts_of_file(log, recording, config)
        notes.append(
            "sonar mounting is taken from the robot's file, because the log does not have it"
        )
    if map_name:
        world_map, map_by = load_localisation_map(map_name, Path()), Path(map_name).name
    elif len(recording.scans) > 1:
        world_map = _map_of(log, recording, poses, config)
        map_by = "the log's even scans; measured on the odd ones"
        recording = replace(recording, scans=tuple(choose_scans(recording, "odd")))
    else:
        raise ConfigError(
            f"--log {log}: no scans in it to make a map from; give the room with --map, a world "
            "(.toml) or a ROS map (.yaml)"
        )
    return Source(sensor, recording, poses, world_map, mounts, poses_by, map_by, tuple(notes))


def _readings(sensor: str, recording: Recording) -> tuple[str, Sequence[object]]:
    """Return the name and the readings of a sensor."""
    if sensor == SONAR:
        return "sonar readings", recording.sonars
    return "lidar scans", recording.scans


def _mounts_of_file(log: Path, recording: Recording, config: RobotConfig) -> tuple[SonarMount, ...]:
    """Return the sonars of the robot's file; raises `CalibrationError` if the log has others."""
    count = len(recording.sonars[0].reading.ranges_m)
    if count != len(config.sonar):
        raise CalibrationError(
            f"{log}: {count} sonars in it, but the file of {config.robot.name} has "
            f"{len(config.sonar)}: give the --robot that recorded it"
        )
    return config.sonar


def _has(recording: Recording) -> str:
    """Say what there is instead."""
    has = [
        f"{len(entries)} {name}"
        for name, entries in (("sonar readings", recording.sonars), ("scans", recording.scans))
        if entries
    ]
    return f", only {has[0]}" if has else ", neither of sonars nor of a lidar"


def _map_of(log: Path, recording: Recording, poses: Trajectory, config: RobotConfig) -> WorldMap:
    """Return a map of the even scans."""
    grid = OccupancyGrid(config.localisation.grid)
    chosen = [
        (pose, entry.scan)
        for entry in choose_scans(recording, "even")
        if (pose := poses.at(entry.scan.stamp_ns)) is not None
    ]
    try:
        rows = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose, _ in chosen])
        grid.update_scans(rows.reshape(-1, 3), [scan for _, scan in chosen])
    except ValueError as error:
        raise CalibrationError(f"{log}: no map can be made of its scans: {error}") from error
    return WorldMap(grid.to_map(), None)


def simulated_drive(
    robot: Path,
    overrides: Sequence[str],
    seed: int,
    world: str,
    sensor: str,
    folder: Path,
    progress: Progress,
) -> str:
    """Let the simulated robot drive its round in lockstep and record it; return its world.

    Scans are taken and recorded if something uses them, as a mapper does.

    Raises
    ------
    ConfigError, SimulatorError
        If a file is wrong or the robot does not fit into the world.
    """
    mission = find_file(MISSION, "missions")
    run = LockstepRun(
        SimOptions(
            robot,
            mission,
            world,
            seed=seed,
            overrides=tuple(overrides),
            record=folder,
            localisation=("localisation.mapping=true",) if sensor == LIDAR else (),
        )
    )
    told_ns = 0
    for control, _ in run.steps():
        if control.stamp_ns >= told_ns:
            told_ns += _TELL_EVERY_NS
            progress(f"the simulated robot drives: {control.stamp_ns * 1e-9:.0f} s")
    return str(run.world)


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Readings with the sensors that took them.

    Parameters
    ----------
    readings
        From where, and what.
    sigmas_m
        Their standard deviations by the present settings, (m,) [m].
    mounts
        Of the sensors in `base`, (k, 3): x, y, direction [m, m, rad].
    beam_rad
        Opening of their cones [rad].
    """

    readings: Readings
    sigmas_m: NDArray[np.float64]
    mounts: NDArray[np.float64]
    beam_rad: float


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


def taken(source: Source, config: RobotConfig) -> Taken:
    """Return the readings of a source.

    Raises
    ------
    CalibrationError
        If none was taken at a known pose.
    """
    kind, settings = CALIBRATIONS[source.sensor], config.localisation
    poses, sensors, ranges, sigmas = [], [], [], []
    beams, max_range_m = np.empty((0, 3)), None
    for measurement in kind.measurements(source.recording, source.mounts, settings):
        pose = source.pose_at(measurement.stamp_ns, config.odometry)
        if pose is None:
            continue
        beams, max_range_m = measurement.beams, measurement.max_range_m
        fired = np.flatnonzero(~np.isnan(measurement.ranges_m))
        poses.append(np.tile((pose.x_m, pose.y_m, pose.theta_rad), (len(fired), 1)))
        sensors.append(fired)
        ranges.append(measurement.ranges_m[fired])
        sigmas.append(measurement.sigmas_m[fired])
    if not any(len(each) for each in ranges):
        raise CalibrationError(
            f"{source.recording.name}: no reading has a pose from {source.poses_by}"
        )
    lines = Sightlines(np.concatenate(poses), np.concatenate(sensors))
    readings = Readings(lines, np.concatenate(ranges), max_range_m)
    return Taken(readings, np.concatenate(sigmas), beams, kind.beam_rad(settings))
