"""The estimating half of navigation: a place in the world and a map, from sensors and odometry."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from robotctl.app.config import RobotConfig
from robotctl.app.ekf_localiser import EkfLocaliser
from robotctl.app.localisation_map import load_localisation_map
from robotctl.app.localiser import Localiser
from robotctl.app.mapper import Mapper
from robotctl.app.mcl_localiser import MclLocaliser
from robotctl.app.odometry_history import OdometryHistory
from robotctl.errors import ConfigError
from robotctl.estimation.compiled import cache_is_cold
from robotctl.estimation.ekf import PoseEkf
from robotctl.estimation.ekf_config import EkfConfig
from robotctl.estimation.ekf_models import SonarBeam
from robotctl.estimation.free_space import free_poses
from robotctl.estimation.likelihood_field import LikelihoodField
from robotctl.estimation.mcl import MonteCarloLocaliser
from robotctl.estimation.mcl_config import MclConfig
from robotctl.estimation.occupancy_grid import OccupancyGrid
from robotctl.estimation.sonar_model import SonarModel
from robotctl.estimation.wall_raster import grid_of_walls
from robotctl.model.localisation import LocalisationStatus
from robotctl.model.pose_estimate import PoseEstimate
from robotctl.model.range_scan import RangeScan
from robotctl.model.se2 import SE2
from robotctl.model.wall_map import WallMap
from robotctl.runtime.messages import (
    ControlState,
    ExternalPose,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
)

Picture: TypeAlias = ParticleCloud | LiveMap

_PICTURE_NS: Final = 500_000_000
_SHOWN: Final = 300
"""Particles in a picture."""

_WORDS: Final = {
    LocalisationStatus.SEARCHING: "the robot does not know where it is; it looks around",
    LocalisationStatus.LOCALISED: "the robot knows where it is",
    LocalisationStatus.LOST: "what the robot sees does not fit to where it believed to be",
}


class Estimators:
    """Localiser and mapper of one robot, either of which may be missing.

    Attributes
    ----------
    rejected
        Scans that were no scans.

    Parameters
    ----------
    localiser, mapper
        Both of the same `history`.
    history
        Of the odometry.
    """

    def __init__(
        self, localiser: Localiser | None, mapper: Mapper | None, history: OdometryHistory
    ) -> None:
        self.localiser = localiser
        self.mapper = mapper
        self.rejected = 0
        self._history = history
        self._state: LocalisationState | None = None
        self._pictured_ns = 0
        self._status: LocalisationStatus | None = None
        self._said_rejected = False

    def step(
        self,
        control: ControlState,
        scans: Sequence[LidarScan],
        poses: Sequence[ExternalPose],
        now_ns: int,
    ) -> LocalisationState | None:
        """Take in all that came since the last step; return what the localiser believes."""
        self._history.add(control.stamp_ns, SE2(control.x_m, control.y_m, control.theta_rad))
        good = [scan for scan in map(self._range_scan, scans) if scan is not None]
        if self.localiser is not None:
            self._state = self.localiser.step(control, good, poses, now_ns)
        if self.mapper is not None:
            self.mapper.step(control, self._state, good)
        return self._state

    def _range_scan(self, scan: LidarScan) -> RangeScan | None:
        """Return a message as a scan; None, and counted, where it is none."""
        try:
            ranges = np.frombuffer(scan.ranges, np.dtype("<f4")).astype(np.float64)
            angles = scan.first_rad + scan.step_rad * np.arange(len(ranges), dtype=np.float64)
            return RangeScan(scan.stamp_ns, angles, ranges, scan.max_range_m, scan.x_m, scan.y_m)
        except ValueError:
            self.rejected += 1
            return None

    def news(self) -> list[str]:
        """Return sentences on what has changed since the last call."""
        said = []
        if self._state is not None and self._state.status is not self._status:
            self._status = self._state.status
            said.append(_WORDS[self._status])
        if self.rejected and not self._said_rejected:
            self._said_rejected = True
            said.append("a lidar scan was no scan and is left out, as those like it will be")
        return said

    def pictures(self, now_ns: int) -> list[Picture]:
        """Return what people see of the estimators, twice a second."""
        if now_ns - self._pictured_ns < _PICTURE_NS:
            return []
        self._pictured_ns = now_ns
        found: list[Picture] = []
        if self.localiser is not None and len(self.localiser.particles):
            every = math.ceil(len(self.localiser.particles) / _SHOWN)
            shown = self.localiser.particles[::every].astype(np.dtype("<f4"))
            found.append(ParticleCloud(now_ns, shown.tobytes()))
        if self.mapper is not None:
            grid = self.mapper.live_map(now_ns)
            if grid is not None:
                found.append(grid)
        return found


def make_estimators(config: RobotConfig, start: SE2, beside: Path) -> Estimators:
    """Return the estimators of a robot that starts at a pose, compiled and ready.

    `beside` is the folder of the robot's file, where its map may lie.

    Raises
    ------
    ConfigError
        If the map cannot be read or does not fit the method.
    """
    _rehearse(config)
    history = OdometryHistory()
    grid = OccupancyGrid(config.localisation.grid)
    mapper = Mapper(grid, config.sonar, history) if config.localisation.mapping else None
    return Estimators(_localiser(config, start, beside, history), mapper, history)


def _rehearse(config: RobotConfig) -> None:
    """Run all kernels once in a room of no meaning: each is compiled, or loaded from the cache."""
    if cache_is_cold():
        print("compiling the estimators, once: up to a minute", file=sys.stderr, flush=True)  # noqa: T201
    walls = WallMap(np.array([[0, 0, 4, 0], [4, 0, 4, 4], [4, 4, 0, 4], [0, 4, 0, 0]], np.float64))
    here, angles = SE2(2.0, 2.0, 0.0), np.linspace(-1.0, 1.0, 21)
    scan = RangeScan(0, angles, np.full(21, 2.0), 10.0)
    chart = grid_of_walls(walls)
    mcl = MonteCarloLocaliser(MclConfig(), free_poses(chart), np.random.default_rng(0))
    measurements = [LikelihoodField(chart).measurement(scan)]
    if config.sonar:
        ranges_m = np.full(len(config.sonar), 1.5)
        measurements += [
            SonarModel(room, config.sonar).measurement(ranges_m) for room in (walls, chart)
        ]
    for measurement in measurements:
        mcl.measure(measurement)
    mcl.start_at(here, 0.1, 0.1)
    for measurement in measurements:
        mcl.move(SE2(0.2, 0.0, 0.1))
        mcl.measure(measurement)
    grid = OccupancyGrid()
    grid.update_scan(here, scan)
    for mount in config.sonar:
        grid.update_sonar(here, mount, 1.5)
    grid.to_map()


def _localiser(
    config: RobotConfig, start: SE2, beside: Path, history: OdometryHistory
) -> Localiser | None:
    """Return the localiser of a robot; None where odometry is enough."""
    settings = config.localisation
    if settings.method == "none":
        return None
    chart = load_localisation_map(settings.map, beside)
    sigma_rad = math.radians(settings.start_sigma_deg)
    if settings.method == "ekf":
        if chart.walls is None:
            raise ConfigError(
                f"localisation.map: {settings.map} has cells; the EKF needs walls, a world (.toml)"
            )
        covariance = np.diag([settings.start_sigma_m**2, settings.start_sigma_m**2, sigma_rad**2])
        known = PoseEstimate(0, start, covariance, LocalisationStatus.LOCALISED)
        sonar = settings.sonar
        ekf_config = EkfConfig(
            motion=config.odometry,
            sonar_sigma_m=sonar.sigma_m,
            sonar_sigma_m_per_m=sonar.sigma_per_m,
            sonar_beam=SonarBeam(
                math.radians(0.5 * sonar.beam_deg), math.radians(sonar.max_incidence_deg)
            ),
        )
        ekf = PoseEkf(ekf_config, known)
        return EkfLocaliser(ekf, config.sonar, chart.walls, settings.sonar.max_range_m)
    rng = np.random.default_rng(settings.seed)
    bounds = MclConfig(max_particles=settings.particles_max)
    mcl = MonteCarloLocaliser(bounds, free_poses(chart.grid), rng)
    if settings.start == "known":
        mcl.start_at(start, settings.start_sigma_m, sigma_rad)
    room = chart.grid if chart.walls is None else chart.walls
    sonars = SonarModel(room, config.sonar, settings.sonar) if config.sonar else None
    return MclLocaliser(mcl, LikelihoodField(chart.grid, settings.lidar), sonars, history)
