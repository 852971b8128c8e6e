"""Settings of the pose EKF."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robotctl.estimation.kalman.robust_kalman import RobustConfig
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model.drives.motion_noise import MotionNoise


@dataclass(frozen=True, slots=True)
class EkfConfig:
    """Noises and limits of `PoseEkf`.

    Parameters
    ----------
    motion
        How the pose's covariance grows with encoder increments.
    velocity_sigma_m_s, turn_rate_sigma_rad_s
        Uncertainty of the velocities after encoder steps [m/s], [rad/s], > 0.
    acceleration_m_s2, turn_acceleration_rad_s2
        How much the velocities change in 1 s where no encoder tells [m/s], [rad/s], > 0.
    gyro
        Whether there is an IMU: the state has a gyro bias.
    gyro_sigma_rad_s, gyro_bias_sigma_rad_s, gyro_bias_walk_rad_s
        Of one reading, of the bias at the start, and of its change in 1 s [rad/s], > 0.
    sonar
        Noise of the ranges, cone and greatest incidence; its probabilities are for particles.
    landmark_range_sigma_m, landmark_range_sigma_m_per_m, landmark_bearing_sigma_rad
        Of a sighting: of the range [m], > 0, its growth with the range, >= 0, of the bearing
        [rad], > 0.
    robust
        Treatment of large innovations.
    history_s
        How late a measurement may come [s], >= 0.
    window
        Innovations that say whether the belief is contradicted, > 0.
    searching_sigma_m
        Standard deviation of the position beyond which the pose is a guess [m], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    motion: MotionNoise = field(default_factory=MotionNoise)
    velocity_sigma_m_s: float = 0.02
    turn_rate_sigma_rad_s: float = 0.02
    acceleration_m_s2: float = 0.5
    turn_acceleration_rad_s2: float = 2.0
    gyro: bool = False
    gyro_sigma_rad_s: float = 0.005
    gyro_bias_sigma_rad_s: float = 0.02
    gyro_bias_walk_rad_s: float = 1e-4
    sonar: SonarModelConfig = field(default_factory=SonarModelConfig)
    landmark_range_sigma_m: float = 0.05
    landmark_range_sigma_m_per_m: float = 0.02
    landmark_bearing_sigma_rad: float = 0.02
    robust: RobustConfig = field(default_factory=RobustConfig)
    history_s: float = 1.0
    window: int = 20
    searching_sigma_m: float = 0.5

    def __post_init__(self) -> None:
        may_be_zero = ("landmark_range_sigma_m_per_m", "history_s")
        for key in self.__slots__:
            value = getattr(self, key)
            if not isinstance(value, (int, float)) or isinstance(value, bool):
                continue
            if not math.isfinite(value) or value < 0.0 or (value == 0.0 and key not in may_be_zero):
                least = ">= 0" if key in may_be_zero else "> 0"
                raise ValueError(f"{key}: {value} found, a finite number {least} allowed")
