"""The extended Kalman filter in the navigation process."""

from __future__ import annotations

import dataclasses
import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.app.localisation.localiser import (
    LocaliserBegin,
    LocaliserInput,
    MadeLocaliser,
    external_covariance,
    localisation_state,
    sensed_robot,
)
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.kalman.robust_kalman import Innovation
from robotctl.estimation.odometry.estimate import arc_between
from robotctl.estimation.sensors.registry import load_sensors
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.maps.localisation_map import walls_of
from robotctl.messages.control import ControlState, ImuFeedback
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap


class EkfLocaliser:
    """Predicts by the odometry, corrects by gyro, sonar ranges to walls and poses from outside.

    It has no use for lidar scans, see `Sensor.innovations`.

    Parameters
    ----------
    ekf
        The filter, where it starts.
    robot
        What is known of its sensors.
    walls
        The map.
    """

    def __init__(self, ekf: PoseEkf, robot: SensedRobot, walls: WallMap) -> None:
        self._ekf = ekf
        self._robot = robot
        self._sensors = load_sensors()
        self._walls = walls
        self._odometry: SE2 | None = None
        self._imu: ImuFeedback | None = None
        """Odometry and gyro of the step before."""
        self._innovation: Innovation | None = None

    @property
    def particles(self) -> NDArray[np.float64]:
        """No particles: (0, 3)."""
        return np.empty((0, 3))

    def begin_odometry(self) -> None:
        """Keep the belief; the next control state's odometry is another one."""
        self._odometry = None

    def take_notices(self) -> list[str]:
        """Nothing that its state does not say."""
        return []

    def step(self, control: ControlState, seen: LocaliserInput, now_ns: int) -> LocalisationState:
        """Process everything since the last step; return the present estimate."""
        ekf, self._innovation = self._ekf, None
        odometry = control.T_odom_base
        if self._odometry is None:
            ekf.reset(dataclasses.replace(ekf.estimate(), stamp_ns=control.stamp_ns))
        elif control.stamp_ns > ekf.stamp_ns:
            dt_s = (control.stamp_ns - ekf.stamp_ns) * 1e-9
            distance_m, turn_rad = arc_between(self._odometry.inverse() @ odometry)
            self._keep(*ekf.predict(control.stamp_ns, distance_m, turn_rad))
            if self._imu is not None and control.imu is not None:
                turn_rad += _ahead_rad(control.imu) - _ahead_rad(self._imu)
                self._keep(ekf.update_gyro(control.stamp_ns, turn_rad / dt_s))
        self._odometry, self._imu = odometry, control.imu
        for name, sensor in self._sensors.items():
            for each in seen.measured.get(name, ()):
                self._keep(*sensor.innovations(ekf, each, self._robot, self._walls))
        for pose in seen.poses:
            where = SE2(pose.x_m, pose.y_m, pose.theta_rad)
            covariance = external_covariance(pose, self._robot.settings)
            self._keep(ekf.update_pose(pose.stamp_ns, where, covariance))
        state = localisation_state("ekf", ekf.estimate(), odometry, now_ns)
        last = self._innovation
        if last is None:
            return state
        return msgspec.structs.replace(state, nis=last.nis, nis_dof=last.dof)

    def _keep(self, *innovations: Innovation | None) -> None:
        for innovation in innovations:
            if innovation is not None:
                self._innovation = innovation


def make(begin: LocaliserBegin) -> MadeLocaliser:
    """Return the EKF of a robot.

    Raises
    ------
    ConfigError
        If the map is wrong, or has no walls that are lines.
    """
    config, settings = begin.config, begin.config.localisation
    world_map = begin.world_map()
    walls = walls_of(world_map, settings.map, settings.method)
    sigma_m, sigma_rad = settings.start_sigma_m, math.radians(settings.start_sigma_deg)
    covariance = np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])
    known = PoseEstimate(0, begin.start, covariance, LocalisationStatus.LOCALISED)
    ekf = PoseEkf(
        EkfConfig(motion=config.odometry, sonar=settings.sonar, gyro=config.imu.enabled), known
    )
    return MadeLocaliser(EkfLocaliser(ekf, sensed_robot(config), walls), world_map)


def _ahead_rad(imu: ImuFeedback) -> float:
    """Return by how much the gyro is ahead of the odometry's turning, which may have taken some."""
    return imu.ahead_rad - imu.corrected_rad
