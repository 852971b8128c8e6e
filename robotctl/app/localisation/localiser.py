"""Common base of the localisers of the navigation process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.config.robot_file import RobotConfig
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.messages.control import ControlState, ExternalPose
from robotctl.messages.estimation import CameraView, LiveMap, LocalisationState, SlamGraph
from robotctl.model.geometry.pose_estimate import PoseEstimate, from_upper_triangle, upper_triangle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.world_map import WorldMap

_LEAST_VARIANCE: Final = 1e-6
"""Minimum variance: nothing measures better than 1 mm and 1 mrad [m^2, rad^2]."""
_MOST_VARIANCE: Final = 1e6
"""An accuracy of 1 km and 1000 rad carries no information; larger variances are clipped [m^2,
rad^2]."""
_LEAST_OF_CORRELATION: Final = 1e-9
_LEAST_OF_COVARIANCE: Final = 1e-12
"""Shares that the smallest eigenvalue has at least of the largest: less is rounding."""


class LocaliserBegin(NamedTuple):
    """Ingredients of a localiser."""

    config: RobotConfig
    start: SE2
    """`base` in `world`, where that is known."""
    history: OdometryHistory
    """History of the odometry; its owner, who steps the localiser, keeps it up to date."""
    beside: Path
    """Folder of the robot's file, where other files may lie."""
    state: Path | None = None
    """Folder of what survives restarts; None: there is none."""

    def world_map(self) -> WorldMap:
        """Return the map that the robot's file names.

        Raises
        ------
        ConfigError
            If there is none, it is wrong, or no robot can find itself in it.
        """
        cell_m = self.config.navigation.map.cell_m
        return load_localisation_map(self.config.localisation.map, self.beside, cell_m)


def sensed_robot(config: RobotConfig) -> SensedRobot:
    """Return what the sensors need to know of a robot."""
    return SensedRobot(config.sonar, config.localisation, config.has_camera, config.odometry)


class LocaliserInput(NamedTuple):
    """Sensor data since the last step, each with its own time."""

    measured: Mapping[str, Sequence[Any]] = {}
    """Measurements by each sensor of `SENSORS`."""
    poses: Sequence[ExternalPose] = ()
    images: Sequence[CameraView] = ()
    """Views with features, to recognise places by."""
    is_paused: bool = False
    """Whether the map that the robot makes stays as it is."""


class Localiser(Protocol):
    """Estimates where `base` is in `world`."""

    def step(self, control: ControlState, seen: LocaliserInput, now_ns: int) -> LocalisationState:
        """Process everything since the last step; return the present estimate."""

    def begin_odometry(self) -> None:
        """Keep the belief; the next control state's odometry is another one."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """Particles, (n, 3) [m, m, rad]; (0, 3) if there are none."""

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""


class GrowingMap(Protocol):
    """A map that is drawn while the robot drives."""

    def step(self, localisation: LocalisationState | None, seen: LocaliserInput) -> None:
        """Draw what was seen since the last step; without a localiser `localisation` is None."""

    def settled_map(self) -> GridMap | None:
        """Return the map to plan on; None: it is for people only, or about to be redrawn."""

    def pictures(self, now_ns: int) -> list[LiveMap | SlamGraph]:
        """Return the map, and what it hangs on, for display; empty if nothing has been seen."""


class MadeLocaliser(NamedTuple):
    """A localiser, and what comes with it, the growing map too."""

    localiser: Localiser | None
    """None: the robot goes by odometry alone."""
    world_map: WorldMap | None = None
    """The map that the robot localises itself in; None: it knows none."""
    drawing: GrowingMap | None = None
    """Draws the map that the localiser makes; None: it makes none."""
    close: Callable[[], None] = lambda: None
    """Saves what is kept, at the end."""
    notices: Sequence[str] = ()
    """Notices to publish at once."""


def localisation_state(
    method: str, estimate: PoseEstimate, odometry: SE2, now_ns: int
) -> LocalisationState:
    """Return an estimate as a message; `odometry` is where the odometry had `base` at its time."""
    T_world_odom = estimate.pose @ odometry.inverse()
    return LocalisationState(
        stamp_ns=now_ns,
        method=method,
        status=estimate.status,
        x_m=T_world_odom.x_m,
        y_m=T_world_odom.y_m,
        theta_rad=T_world_odom.theta_rad,
        covariance=upper_triangle(estimate.covariance),
    )


def external_covariance(pose: ExternalPose, settings: LocalisationConfig) -> NDArray[np.float64]:
    """Return the covariance (3, 3) of an external pose, or its diagonal if invalid.

    It can be inverted: variances are kept within 1e-6 and 1e6, and correlations that leave no
    room, or come near it by 1e-9, are not believed.
    """
    if len(pose.covariance) != 6:
        sigma_m, sigma_rad = settings.external_sigma_m, settings.external_sigma_rad
        return np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])
    matrix = from_upper_triangle(pose.covariance)
    variances = np.clip(np.diag(matrix), _LEAST_VARIANCE, _MOST_VARIANCE)
    np.fill_diagonal(matrix, variances)
    sigmas = np.sqrt(variances)
    correlation = matrix / np.outer(sigmas, sigmas)
    if _is_positive(correlation, _LEAST_OF_CORRELATION) and _is_positive(
        matrix, _LEAST_OF_COVARIANCE
    ):
        return matrix
    return np.diag(variances)


def _is_positive(matrix: NDArray[np.float64], least: float) -> bool:
    """Say whether the smallest eigenvalue is more than `least` of the largest."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] > least * eigenvalues[-1])
