"""Source of scans that SLAM can match, with their noise, for each kind of sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, Protocol, TypeVar

from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.keyframes.config import CalibratedWheels, KeyframeConfig
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording

M_contra = TypeVar("M_contra", contravariant=True)

UNKNOWN_WHEELS: Final = CalibratedWheels(MotionNoise(0.033, 0.014, 0.033))
"""Wheels of a recorded robot whose file is not at hand.

Beside white noise of 0.01, calibration may be off by 1 % in length and turns and by 3 mrad a metre:
that is as uncertain after 10 m and 10 rad.
"""


class ScanMaker(Protocol[M_contra]):
    """Makes scans of what a sensor measures."""

    def add(self, measured: M_contra, odometry: SE2) -> list[RecordedScan]:
        """Take what was measured in the order of time, with `base` in `odom` then; return scans."""


@dataclass(frozen=True, slots=True)
class ScanSource(Generic[M_contra]):
    """One kind of sensor, as SLAM takes it.

    Parameters
    ----------
    config
        Settings of a mapper for its scans, by a robot that is not known.
    maker
        Makes what makes its scans, for a robot; raises ValueError if the robot has no such sensor.
    recorded
        Measurements of a recording, each with the odometry.
    """

    config: KeyframeConfig
    maker: Callable[[SensedRobot], ScanMaker[M_contra]]
    recorded: Callable[[Recording], Sequence[tuple[Any, SE2]]]

    def config_for(self, robot: SensedRobot) -> KeyframeConfig:
        """Return the settings of a mapper for a robot, along whose odometry stretches lie."""
        if not self.config.stretch_m:
            return self.config
        return replace(self.config, wheels=CalibratedWheels(robot.odometry))
