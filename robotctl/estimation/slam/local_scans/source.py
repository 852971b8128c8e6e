"""Source of scans that SLAM can match, with their noise, for each kind of sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam_config import KeyframeConfig, WheelNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording

M_contra = TypeVar("M_contra", contravariant=True)

CALIBRATED = WheelNoise((0.01, 0.05, 0.02), (0.003, 0.02, 0.03))
"""Noise of calibrated wheels, along whose odometry local scans are made."""


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
        What its scans are worth.
    maker
        Makes what makes its scans, for a robot; raises ValueError if the robot has no such sensor.
    recorded
        What a recording has of it, with the odometry.
    """

    config: KeyframeConfig
    maker: Callable[[SensedRobot], ScanMaker[M_contra]]
    recorded: Callable[[Recording], Sequence[tuple[Any, SE2]]]
