"""The motion by the encoders, as the monitors see it."""

from __future__ import annotations

from robotctl.control.wheel_loop import WheelLoop
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.model.geometry.se2 import SE2


class EncoderMotion:
    """What the wheels' estimators and odometry say now.

    Parameters
    ----------
    wheels
        The driven wheels.
    odometry
        Of these.
    """

    def __init__(self, wheels: tuple[WheelLoop, ...], odometry: Odometry) -> None:
        self._wheels = wheels
        self._odometry = odometry

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """Speed of each driven wheel [rad/s]."""
        return tuple([wheel.estimator.velocity_rad_s for wheel in self._wheels])

    @property
    def jumps(self) -> int:
        """Impossible jumps of the counts so far."""
        return sum([wheel.estimator.jumps for wheel in self._wheels])

    @property
    def pose_odom_base(self) -> SE2:
        """Pose of odometry."""
        return self._odometry.pose_world_base
