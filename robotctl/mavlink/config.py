"""Configuration of the MAVLink side, the `[mavlink]` section of a robot's file."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from robotctl.errors import InvalidValue
from robotctl.mavlink.globe import Origin
from robotctl.messages.mavlink_port import LinkConfig

Name: TypeAlias = Literal["ardupilot", "px4", "generic"]
"""Name of a personality: here, as robot files need none of MAVLink's messages."""
MIN_RATE_HZ = 0.001
MAX_RATE_HZ = 100.0
"""Bounds of a rate [Hz]."""


@dataclass(frozen=True, slots=True)
class StreamRates:
    """Rate of each message to every peer, until that requests other rates.

    0 switches a message off; others are 0.001 to 100. HEARTBEAT goes out once a second, always.

    Parameters
    ----------
    attitude_hz : float
        ATTITUDE [Hz].
    position_hz : float
        LOCAL_POSITION_NED [Hz].
    odometry_hz : float
        ODOMETRY [Hz].
    wheel_distance_hz : float
        WHEEL_DISTANCE [Hz].
    sonar_hz : float
        DISTANCE_SENSOR of each sonar [Hz].
    imu_hz : float
        SCALED_IMU [Hz], of robots that have an IMU.
    battery_hz : float
        BATTERY_STATUS [Hz].
    status_hz : float
        SYS_STATUS [Hz].
    """

    attitude_hz: float = 10.0
    position_hz: float = 10.0
    odometry_hz: float = 10.0
    wheel_distance_hz: float = 5.0
    sonar_hz: float = 5.0
    imu_hz: float = 10.0
    battery_hz: float = 1.0
    status_hz: float = 1.0

    def __post_init__(self) -> None:
        for rate in dataclasses.fields(self):
            value = getattr(self, rate.name)
            if value != 0.0 and not MIN_RATE_HZ <= value <= MAX_RATE_HZ:
                raise InvalidValue(
                    rate.name,
                    f"must be 0 (off) or {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}, not {value}",
                    value,
                )


@dataclass(frozen=True, slots=True)
class MavlinkConfig:
    """MAVLink identity, links and rates.

    Parameters
    ----------
    system_id, component_id : int
        Address of the robot in the MAVLink network, 1 to 255 each.
    personality : str
        What the robot claims to be: "ardupilot" (a rover of ArduPilot), "px4" or "generic".
        Stations conclude from it how modes are numbered and parameters packed.
    link : tuple of LinkConfig
        The links, all used at once.
    rates : StreamRates
        Rates of the periodic messages.
    setpoint_timeout_s : float
        Velocity set-points and manual control are void after this long [s], 0.2 to 1; set-points
        from their sending where their `time_boot_ms` tells, all else from its arrival. Velocities
        that come at 5 Hz or more are void after 0.3 s at the latest.
    gcs_timeout_s : float
        A ground station is lost when its heartbeat is older [s], 1 to 60.
    gcs_system_id : int
        System of the operator's ground station, 1 to 255, not the robot's own: once it was heard,
        its loss counts, not that of others.
    hold_on_gcs_loss : bool
        The robot goes to HOLD when a ground station that was there is lost.
    hold_without_gcs : bool
        The robot drives by itself (AUTO, RTL, GUIDED) only while a ground station is there.
    allow_shutdown : bool
        A ground station may end robotctl on the robot (PREFLIGHT_REBOOT_SHUTDOWN, param1 2); only
        somebody at its computer starts it again then.
    signing_key : str
        File of the key with which messages are signed, an absolute path; empty: they are not.
    tlog : str
        Folder for records of the links, an absolute path; empty: none are made.
    origin : Origin
        Where the origin of `world` lies on the globe; None: a ground station may say so.

    Raises
    ------
    ValueError
        If a value is out of range, two links are the same, or a ground station is needed and there
        is no link to one.
    """

    system_id: int = 1
    component_id: int = 1
    personality: Name = "ardupilot"
    link: tuple[LinkConfig, ...] = ()
    rates: StreamRates = StreamRates()
    signing_key: str = ""
    tlog: str = ""
    origin: Origin | None = None
    setpoint_timeout_s: float = 0.5
    gcs_timeout_s: float = 5.0
    gcs_system_id: int = 255
    hold_on_gcs_loss: bool = True
    hold_without_gcs: bool = False
    allow_shutdown: bool = False

    def __post_init__(self) -> None:
        for name in ("system_id", "component_id", "gcs_system_id"):
            if not 1 <= getattr(self, name) <= 255:
                raise InvalidValue(
                    name, f"must be 1 to 255, not {getattr(self, name)}", getattr(self, name)
                )
        _check_range("setpoint_timeout_s", self.setpoint_timeout_s, 0.2, 1.0)
        _check_range("gcs_timeout_s", self.gcs_timeout_s, 1.0, 60.0)
        for name in ("signing_key", "tlog"):
            path = getattr(self, name)
            if path and not path.startswith("/"):
                raise InvalidValue(name, f"{path} found, an absolute path allowed", path)
        urls = [link.url for link in self.link]
        if repeated := sorted({url for url in urls if urls.count(url) > 1}):
            raise ValueError(f"links must differ, found more than once: {', '.join(repeated)}")
        if self.hold_without_gcs and not self.link:
            raise InvalidValue(
                "hold_without_gcs",
                "true found, but there is no link to a ground station",
                self.hold_without_gcs,
            )


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise InvalidValue(name, f"must be {low:g} to {high:g}, not {value}", value)
