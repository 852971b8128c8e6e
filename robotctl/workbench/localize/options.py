"""Options of `robotctl localize`, and the inputs of all its methods."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from robotctl.errors import ConfigError, RobotctlError
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.logs.recorded_motion import start_pose
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.toml_source import nearest

METHODS: Final = ("mcl", "ekf")
START_SIGMA_M: Final = 0.25
START_SIGMA_RAD: Final = 0.1
"""Standard deviations of a known start: of x and y, and of the heading."""

TRACKING_PARTICLES: Final = 2000
SEARCHING_PARTICLES: Final = 20_000

Progress: TypeAlias = Callable[[int, int], None]
"""Told how many measurements of how many are done."""


class LocalizeError(RobotctlError):
    """A log, a map and a method do not go together."""


@dataclass(frozen=True, slots=True)
class LocalizeOptions:
    """The options.

    Parameters
    ----------
    log
        File or folder of a recording.
    map
        A ROS map, or a world; "": landmarks are the map.
    method
        One of `METHODS`.
    search
        Start anywhere on the map instead of near the reference.
    particles
        Most particles; None: `TRACKING_PARTICLES`, with `search` `SEARCHING_PARTICLES`, and while
        the place is not known as many as the map's area takes.
    beams
        Beams weighed of each scan; None: as `sensors` says.
    scans
        See `mapping.choose_scans`.
    odometry_noise
        Noise put on the odometry: of the distance after 1 m [m], and of the heading after 1 m and
        after 1 rad [rad], standard deviations.
    seed
        Seed of everything random.
    mrclam_robot
        Robot of an MRCLAM folder.
    sensors
        Parameters of lidar and sonars for the particles; None: the defaults.
    odometry
        Noise of the robot's odometry; None: the default.
    max_range_m, time_unit
        See `read_recording`.
    start
        `base` in `world` at the first measurement; None: as the reference has it.
    reference
        A TUM file to compare with, instead of the log's own reference.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """

    log: Path
    map: str = ""
    method: str = "mcl"
    search: bool = False
    particles: int | None = None
    beams: int | None = None
    scans: str = "all"
    odometry_noise: tuple[float, float] = (0.0, 0.0)
    seed: int = 1
    mrclam_robot: int | None = None
    sensors: LocalisationConfig | None = None
    odometry: MotionNoise | None = None
    max_range_m: float | None = None
    time_unit: str | None = None
    start: SE2 | None = None
    reference: Path | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"--method {self.method}: must be one of {', '.join(METHODS)}"
                f"{nearest(self.method, METHODS)}"
            )
        if not all(0.0 <= sigma < math.inf for sigma in self.odometry_noise):
            raise ConfigError(
                f"--odometry-noise: found {self.odometry_noise}, two finite numbers >= 0 allowed"
            )
        if self.method == "mcl" and not self.map:
            raise ConfigError("--method mcl needs --map MAP.yaml")
        if self.search and self.method != "mcl":
            raise ConfigError(f"--global needs --method mcl, found {self.method}")
        if self.search and self.start is not None:
            raise ConfigError("--start and --global: found both, one of them is allowed")
        if self.sensors is not None and self.method != "mcl":
            raise ConfigError(f"--robot needs --method mcl, found {self.method}")

    @property
    def max_particles(self) -> int:
        """Most particles."""
        if self.particles is not None:
            return self.particles
        return SEARCHING_PARTICLES if self.search else TRACKING_PARTICLES


def known_start(
    recording: Recording,
    options: LocalizeOptions,
    stamp_ns: int,
    rng: np.random.Generator,
    reference: SE2 | None = None,
) -> PoseEstimate:
    """Return the start of the drive and its uncertainty.

    The start of a reference is made as wrong as a known start may be; one that is told is taken as
    it is.

    Parameters
    ----------
    recording, options, stamp_ns
        The drive, what is told of it, and when it begins.
    rng
        Draws how wrong.
    reference
        Where the log says that its first measurement was taken; None: as the reference has it at
        that time, which several measurements may share.

    Raises
    ------
    LocalizeError
        If no reference says where.
    """
    covariance = np.diag(np.square([START_SIGMA_M, START_SIGMA_M, START_SIGMA_RAD]))
    if options.start is not None:
        return PoseEstimate(stamp_ns, options.start, covariance, LocalisationStatus.LOCALISED)
    pose = reference if recording.reference_has_heading else None
    pose = pose or start_pose(recording, stamp_ns)
    if pose is None:
        raise LocalizeError(
            f"{recording.name}: no reference gives the start of the drive; give --start x,y,deg or "
            "--reference FILE; --method mcl can start anywhere: --global"
        )
    x, y, theta = rng.standard_normal(3).tolist()
    wrong = SE2(
        pose.x_m + START_SIGMA_M * x,
        pose.y_m + START_SIGMA_M * y,
        math.remainder(pose.theta_rad + START_SIGMA_RAD * theta, math.tau),
    )
    return PoseEstimate(stamp_ns, wrong, covariance, LocalisationStatus.LOCALISED)
