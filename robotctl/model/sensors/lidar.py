"""A planar lidar: driver and mounting."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from robotctl.errors import InvalidValue

SOCKET = "socket"
"""Driver of a lidar whose scans another program publishes on the robot's local socket `lidar`."""


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """The table `[lidar]` of a robot's file.

    Parameters
    ----------
    driver
        Driver: `rplidar`, or `socket` for a program of your own, or the simulator, that publishes
        its scans.
    device
        Serial device.
    baud
        Bit rate: 115200 for an A1 or A2M8, 256000 for an A2M7, A2M12 or A3.
    name
        Name, by which several are told apart; of several, only one may have none.
    x_m, y_m
        Position of the lidar in `base` [m].
    yaw_deg
        Direction of its zero in `base`, 0 forward, 90 left [deg].
    upside_down
        Whether it is mounted upside down.
    min_range_m, max_range_m
        Minimum and maximum range; other echoes are dropped [m].
    beams
        Beams per scan, the full circle in equal steps, 8 to 3600.
    hidden_deg
        Sectors in which the robot sees itself: from, to [deg], counter-clockwise as seen from
        above, 0 forward of `base`.

    Raises
    ------
    ValueError
        If a number is not finite or not in its range.
    """

    driver: Literal["rplidar", "socket"]
    device: str = "/dev/ttyUSB0"
    baud: int = 115200
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0
    upside_down: bool = False
    min_range_m: float = 0.15
    max_range_m: float = 12.0
    beams: int = 360
    hidden_deg: tuple[tuple[float, float], ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m", "yaw_deg", "min_range_m", "max_range_m"):
            if not math.isfinite(getattr(self, key)):
                raise InvalidValue(
                    key, f"must be finite, not {getattr(self, key)}", getattr(self, key)
                )
        if not self.device:
            raise InvalidValue("device", f"must not be empty, found {self.device!r}", self.device)
        if self.baud <= 0:
            raise InvalidValue("baud", f"must be > 0, not {self.baud}", self.baud)
        if not 0.0 <= self.min_range_m < self.max_range_m:
            raise ValueError(
                "0 <= min_range_m < max_range_m must hold, not "
                f"{self.min_range_m:g} and {self.max_range_m:g}"
            )
        if not 8 <= self.beams <= 3600:
            raise InvalidValue("beams", f"must be 8 to 3600, not {self.beams}", self.beams)
        if not all(math.isfinite(edge) for sector in self.hidden_deg for edge in sector):
            raise InvalidValue(
                "hidden_deg", f"must be finite, not {self.hidden_deg}", self.hidden_deg
            )
