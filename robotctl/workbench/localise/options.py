"""Options of `robotctl localise`, and the inputs of all its methods."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, TypeAlias

import numpy as np
import typer

from robotctl.config.arguments import MaxRange, Sweep, TimeUnit
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


class LocaliseError(RobotctlError):
    """A log, a map and a method do not go together."""


def _start(text: str) -> SE2:
    """Return the pose of --start; raises ConfigError if it is none."""
    try:
        x, y, heading_deg = map(float, text.split(","))
        if not math.isfinite(x + y + heading_deg):
            raise ValueError
    except ValueError:
        raise ConfigError(
            f"--start {text}: three numbers with commas are needed, x [m], y [m] and heading "
            "[deg], e.g. 1.5,-2,90"
        ) from None
    return SE2(x, y, math.remainder(math.radians(heading_deg), math.tau))


@dataclass(frozen=True, slots=True)
class LocaliseOptions:
    """A recorded drive, a map, and how to localise.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """

    log: Annotated[
        Path,
        typer.Option(help="CARMEN log, MRCLAM folder, LEGO log, ROS bag, or a recording of ours."),
    ]
    map: Annotated[
        str, typer.Option(metavar="MAP.yaml", help="ROS map, or a world; for ekf a world.")
    ] = ""
    method: Annotated[
        str, typer.Option(help="mcl: particles and scans. ekf: sightings of landmarks.")
    ] = "mcl"
    search: Annotated[
        bool, typer.Option("--global", help="Start anywhere on the map, not near the reference.")
    ] = False
    start: Annotated[
        SE2 | None,
        typer.Option(parser=_start, metavar="X,Y,DEG", help="Start pose on the map: m, m, deg."),
    ] = None
    reference: Annotated[
        Path | None,
        typer.Option(help="TUM file, or log with a reference, to compare with instead of its own."),
    ] = None
    particles: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Maximum number of particles; default: 2000, for a search by area.",
        ),
    ] = None
    beams: Annotated[
        int | None,
        typer.Option(min=1, help="Beams used of each scan; default: 60, or as --robot says."),
    ] = None
    scans: Annotated[
        str, typer.Option(help="all, even or odd: by position in the log, from 0.")
    ] = "all"
    odometry_noise: Annotated[
        str,
        typer.Option(
            metavar="SIGMA_TRANS,SIGMA_ROT",
            help="Noise added to the odometry: m after 1 m, rad after 1 m or 1 rad.",
        ),
    ] = "0,0"
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 1
    mrclam_robot: Annotated[
        int | None, typer.Option(min=1, help="Robot of an MRCLAM folder; default: 1.")
    ] = None
    max_range_m: MaxRange = None
    sweep_s: Sweep = None
    time_unit: TimeUnit = None
    sensors: LocalisationConfig | None = None
    """Parameters of lidar and sonars for the particles; None: the defaults."""
    odometry: MotionNoise | None = None
    """Noise of the robot's odometry; None: the default."""

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"--method {self.method}: must be one of {', '.join(METHODS)}"
                f"{nearest(self.method, METHODS)}"
            )
        if not all(0.0 <= sigma < math.inf for sigma in self.odometry_sigmas):
            raise ConfigError(
                f"--odometry-noise: found {self.odometry_sigmas}, two finite numbers >= 0 allowed"
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
    def odometry_sigmas(self) -> tuple[float, float]:
        """Noise put on the odometry, standard deviations: after 1 m [m], after 1 m or rad [rad]."""
        try:
            trans, rot = map(float, self.odometry_noise.split(","))
        except ValueError:
            raise ConfigError(
                f"--odometry-noise {self.odometry_noise}: two numbers with a comma are needed, "
                "e.g. 0.1,0.05"
            ) from None
        return trans, rot

    @property
    def max_particles(self) -> int:
        """Most particles."""
        if self.particles is not None:
            return self.particles
        return SEARCHING_PARTICLES if self.search else TRACKING_PARTICLES


def known_start(
    recording: Recording,
    options: LocaliseOptions,
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
    LocaliseError
        If no reference says where.
    """
    covariance = np.diag(np.square([START_SIGMA_M, START_SIGMA_M, START_SIGMA_RAD]))
    if options.start is not None:
        return PoseEstimate(stamp_ns, options.start, covariance, LocalisationStatus.LOCALISED)
    pose = reference if recording.reference_has_heading else None
    pose = pose or start_pose(recording, stamp_ns)
    if pose is None:
        raise LocaliseError(
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
