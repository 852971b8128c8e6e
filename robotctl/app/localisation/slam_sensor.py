"""Which sensor of a robot SLAM makes its map of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from robotctl.config.robot_file import RobotConfig
from robotctl.errors import ConfigError
from robotctl.estimation.localisers import localiser_kind
from robotctl.estimation.sensor_names import CAMERA, LIDAR, SONAR
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.local_scans.registry import SCAN_SOURCES, load_source
from robotctl.estimation.slam.local_scans.source import ScanMaker


class SlamSensor(NamedTuple):
    """A sensor, and what its scans are worth."""

    name: str
    robot: SensedRobot
    config: KeyframeConfig

    def maker(self) -> ScanMaker[Any]:
        """Return what makes scans along a new odometry."""
        return load_source(self.name).maker(self.robot)


def slam_sensor(config: RobotConfig, robot: SensedRobot) -> SlamSensor:
    """Return the first of `SCAN_SOURCES` that a robot has, and may use by `localisation.sensors`.

    A lidar is one that the robot's file names, for the robot or its simulation.

    Raises
    ------
    ConfigError
        If it has none, or is to be localised in a map of keyframes by another than a lidar.
    """
    settings = config.localisation
    has = {
        LIDAR: bool(config.lidars) or LIDAR in config.simulation,
        SONAR: bool(robot.mounts),
        CAMERA: robot.has_camera,
    }
    name = next((each for each in SCAN_SOURCES if has[each] and each in settings.sensors), None)
    if name is None:
        found = ", ".join(each for each in has if has[each]) or "none"
        raise ConfigError(
            f'localisation.method = "slam": needs one of {", ".join(SCAN_SOURCES)}; the robot has '
            f"{found}, localisation.sensors allows {', '.join(settings.sensors) or 'none'}"
        )
    source = load_source(name)
    if settings.keyframes and not settings.mapping and source.config.stretch_m:
        raise ConfigError(
            f"localisation.keyframes = {settings.keyframes!r}: only a lidar tells where a robot is "
            f"on a map of keyframes that stays as it is. With a {name}, localisation.mapping = "
            'true goes on with the map; localisation.method = "mcl" finds the robot on the ROS '
            "map of a drive, localisation.map"
        )
    return SlamSensor(name, robot, replace(source.config_for(robot), tuning=settings.slam.stages))


def recognises_places(config: RobotConfig) -> bool:
    """Return whether a robot looks for loops by the images of its camera."""
    settings = config.localisation
    matches_images = localiser_kind(settings.method).matches_images
    return config.has_camera and matches_images and CAMERA in settings.sensors
