"""How a robot finds out where it is; light enough for every process to read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

from robotctl.errors import InvalidValue
from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.localisers import LocaliserName, localiser_kind, names_with
from robotctl.estimation.mcl.tuning import MclTuning
from robotctl.estimation.ranging.likelihood_config import LikelihoodFieldConfig
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.estimation.sensor_names import SENSORS
from robotctl.estimation.slam_config import SlamConfig

if TYPE_CHECKING:
    SensorName: TypeAlias = str
else:
    SensorName = Literal[tuple(SENSORS)]

_FEWEST: Final = 1000


@dataclass(frozen=True, slots=True)
class LocalisationConfig:
    """How the navigation process estimates the pose.

    Parameters
    ----------
    method
        `none`: odometry only. `ekf`: odometry corrected by sonar ranges to walls and by poses from
        outside (MAVLink). `mcl`: particles, weighed by sonars and lidar, which also find a robot
        that was carried away. `slam`: scans of the lidar, else of what sonars or camera
        make out on the way, matched with those before; it needs no map and makes one.
    map
        A world (`.toml`, walls) or a ROS map (`.yaml`, cells); `ekf` needs walls.
    start
        `known`: the robot starts where its options say. `unknown`: anywhere on the map; only
        `mcl` can do that.
    start_sigma_m, start_sigma_deg
        Standard deviations of a known start [m], [deg], > 0.
    restart_sigma_m, restart_sigma_deg
        Least standard deviations of the start where navigation begins again in a run [m], [deg],
        > 0: the last pose is up to 0.3 s old, and the robot braked since.
    external_sigma_m, external_sigma_rad
        Standard deviations of a pose from outside that gives no covariance [m], [rad], > 0.
    mapping
        Build a map of what sonars and lidar see, from the estimated poses.
    paused
        Whether mapping is paused: the robot is localised, the map that it makes stays as it is. In
        force at once by the parameter MAP_PAUSE.
    seed
        Of the particles.
    particles_max
        Most particles, >= 1000; a tracked robot needs far fewer, a search of a large map takes
        more.
    sensors
        Which sensors particles are weighed by, and `slam` may take, of those that the robot has.
    places
        File of the places that the robot knows by its sonars (`robotctl places learn`), which
        particles are weighed by when it has turned on the spot; empty: none.
    keyframes
        File of the map that `slam` goes on with, and keeps; without `mapping` it localises the
        robot by lidar, and the file stays as it is. Empty: in the folder of what survives restarts.
    mcl
        How particles are weighed and judged.
    slam
        When `slam` takes a scan, and draws its map anew.
    lidar, camera, sonar, grid
        Sensor parameters, for the particles and for the map. Ranges that a camera sees share the
        errors of its mount and of the robot's pitch, so they say less than a lidar's.

    Raises
    ------
    ValueError
        If a value is out of its range, or settings contradict each other.
    """

    method: LocaliserName = "none"
    map: str = ""
    start: Literal["known", "unknown"] = "known"
    start_sigma_m: float = 0.1
    start_sigma_deg: float = 5.0
    restart_sigma_m: float = 0.5
    restart_sigma_deg: float = 10.0
    external_sigma_m: float = 0.1
    external_sigma_rad: float = 0.1
    mapping: bool = False
    paused: bool = False
    seed: int = 1
    particles_max: int = 20_000
    sensors: tuple[SensorName, ...] = tuple(SENSORS)
    places: str = ""
    keyframes: str = ""
    mcl: MclTuning = field(default_factory=MclTuning)
    slam: SlamConfig = field(default_factory=SlamConfig)
    lidar: LikelihoodFieldConfig = field(default_factory=LikelihoodFieldConfig)
    camera: LikelihoodFieldConfig = field(
        default_factory=lambda: LikelihoodFieldConfig(beams=40, beam_correlation=0.2)
    )
    sonar: SonarModelConfig = field(default_factory=SonarModelConfig)
    grid: OccupancyGridConfig = field(default_factory=OccupancyGridConfig)

    def __post_init__(self) -> None:
        for key in (
            "start_sigma_m", "start_sigma_deg", "restart_sigma_m", "restart_sigma_deg",
            "external_sigma_m", "external_sigma_rad",
        ):  # fmt: skip
            if not 0.0 < getattr(self, key) < math.inf:
                raise InvalidValue(
                    key,
                    f"{getattr(self, key)} found, a finite number > 0 allowed",
                    getattr(self, key),
                )
        if self.seed < 0:
            raise InvalidValue("seed", f"{self.seed} found, 0 or more allowed", self.seed)
        if self.particles_max < _FEWEST:
            raise InvalidValue(
                "particles_max",
                f"{self.particles_max} found, {_FEWEST} or more allowed",
                self.particles_max,
            )
        kind = localiser_kind(self.method)
        if self.places and not kind.weighs_places:
            raise InvalidValue(
                "places",
                f'needs method {names_with("weighs_places")}, found "{self.method}": only '
                "particles weigh places",
                self.places,
            )
        if self.keyframes and not kind.makes_map:
            raise InvalidValue(
                "keyframes",
                f'needs method {names_with("makes_map")}, found "{self.method}": only that makes '
                "and reads them",
                self.keyframes,
            )
        if self.start == "unknown" and not kind.searches_map:
            raise InvalidValue(
                "start",
                f'"unknown" needs method {names_with("searches_map")}, found "{self.method}": '
                "only particles can search a map",
                self.start,
            )
