"""Configuration of the CAN side: buses, and the settings of their nodes."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.errors import InvalidValue

_BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Bit rates that CiA 301 and usual controllers know [bit/s]."""
_DATA_BITRATES = (*_BITRATES, 2_000_000, 4_000_000, 5_000_000, 8_000_000)

MAX_SUPPLY_V: Final = 65.5
"""Maximum voltage that a drive can report [V]."""

RESTART_MS: Final = 100
"""Wanted pause between bus-off and the controller's return [ms]."""

FD_MTU: Final = 72
"""CANFD_MTU: size of a frame of CAN FD, and so the MTU of a network device that carries them."""

_DEVICE_BYTES: Final = 15
"""IFNAMSIZ of netdevice(7) less the NUL."""
_DEVICE: Final = re.compile(rb"(?!\.\.?$)[^\s\xa0/:\0]+")
"""As dev_valid_name() of Linux: its isspace() takes Latin-1's no-break space for one too."""
_SIMULATED: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*|[^\0]*/[^\0]*")
"""A name, or the path of a socket, which has a slash in it."""


_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


@dataclass(frozen=True, slots=True)
class CanConfig:
    """A bus of the robot.

    Parameters
    ----------
    interface
        python-can interface: `socketcan` (kernel) or `simcan` (the simulated bus).
    channel
        Network device (`can0`), as Linux allows them to be named; or the simulated bus's name or
        the path of its socket.
    bitrate
        [bit/s], one of CiA 301's. The kernel's interface must have been brought up with it; here
        it only scales the bus load.
    data_bitrate
        Of the data phase of CAN FD [bit/s], at least `bitrate`: where it is higher, frames of CAN
        FD are sent with bit-rate switch. 0: a classic bus.
    sample_point, data_sample_point
        Shares of a bit, 0.5 to 0.9, that the kernel's interface must have been brought up with; 0:
        CiA's recommendation. Some drives at 5 Mbit/s need their own.
    name
        What nodes and drives call it; each bus of a robot has its own.
    """

    interface: Literal["socketcan", "simcan"] = "socketcan"
    channel: str = "can0"
    bitrate: int = 1_000_000
    data_bitrate: int = 0
    sample_point: float = 0.0
    data_sample_point: float = 0.0
    name: str = "main"

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not _NAME.fullmatch(self.name):
            raise InvalidValue(
                "name",
                "must be letters, digits, - and _, a letter first, not " + repr(self.name),
                self.name,
            )
        if not self.channel:
            raise InvalidValue(
                "channel", f"must not be empty, found {self.channel!r}", self.channel
            )
        if self.interface == "socketcan" and not _is_device(self.channel):
            raise InvalidValue(
                "channel",
                "must be the name of a network device, such as can0: at most "
                f"{_DEVICE_BYTES} bytes, no white space, '/' or ':', not {self.channel!r}",
                self.channel,
            )
        if self.interface == "simcan" and not _SIMULATED.fullmatch(self.channel):
            raise InvalidValue(
                "channel",
                "must be the name of a simulated bus (letters, digits, '_', '.' and '-', "
                f"a letter or digit first) or the path of its socket, not {self.channel!r}",
                self.channel,
            )
        if self.bitrate not in _BITRATES:
            allowed = ", ".join(str(bitrate) for bitrate in _BITRATES)
            raise InvalidValue(
                "bitrate", f"must be one of {allowed}, not {self.bitrate}", self.bitrate
            )
        self._check_fd()
        for key in ("sample_point", "data_sample_point"):
            share = getattr(self, key)
            if share and not 0.5 <= share <= 0.9:
                raise InvalidValue(
                    key, f"must be 0.5 to 0.9, or 0 for CiA's recommendation, not {share:g}", share
                )

    def _check_fd(self) -> None:
        """Check the data bit rate."""
        rate = self.data_bitrate
        allowed = [each for each in _DATA_BITRATES if each >= self.bitrate]
        if rate and rate not in allowed:
            words = ", ".join(map(str, allowed))
            raise InvalidValue(
                "data_bitrate",
                f"must be 0 (classic CAN) or, with bitrate {self.bitrate}, one of {words}, "
                f"not {rate}",
                rate,
            )

    @property
    def sample_points(self) -> tuple[float, float]:
        """Sample points of the arbitration and of the data phase, as shares of a bit."""
        return (
            self.sample_point or recommended_sample_point(self.bitrate),
            self.data_sample_point or recommended_sample_point(self.data_bitrate),
        )


def _is_device(name: str) -> bool:
    """Return whether Linux allows a network device of this name."""
    encoded = os.fsencode(name)
    return len(encoded) <= _DEVICE_BYTES and _DEVICE.fullmatch(encoded) is not None


def recommended_sample_point(bitrate: int) -> float:
    """Return the sample point that CiA 301 recommends for a bit rate [bit/s], as a share."""
    return 0.75 if bitrate > 800_000 else 0.8 if bitrate > 500_000 else 0.875


def bring_up(config: CanConfig, kind: str = "") -> str:
    """Return the shell commands that bring up the network device of a SocketCAN bus.

    Parameters
    ----------
    config
        Which bus.
    kind
        What the device is, in words of `ip -details link`; empty if it is not known: it may
        have to be added then, if it is called as virtual ones are.
    """
    up = f"sudo ip link set {config.channel} up"
    if kind in {"vcan", "vxcan"}:
        fd = f"sudo ip link set {config.channel} mtu {FD_MTU}; " if config.data_bitrate else ""
        return f"{fd}{up}"
    if not kind and config.channel.startswith("vcan"):
        fd = f" mtu {FD_MTU}" if config.data_bitrate else ""
        return f"sudo ip link add dev {config.channel}{fd} type vcan; {up}"
    point, data_point = config.sample_points
    timing = f"bitrate {config.bitrate} sample-point {point:g}"
    if config.data_bitrate:
        timing += f" dbitrate {config.data_bitrate} dsample-point {data_point:g} fd on"
    return f"{up} type can {timing} restart-ms {RESTART_MS}"


@dataclass(frozen=True, slots=True)
class PowerConfig:
    """Source of the supply voltage.

    Parameters
    ----------
    source
        `node`: our battery monitor, which has its own limits; `drives`: the motor drives, by the
        limits here.
    low_v
        A battery under this for 2 s is low: the robot does not arm [V].
    critical_v
        A battery under this for 2 s is critical: the robot stops [V].
    """

    source: Literal["node", "drives"] = "node"
    low_v: float = 0.0
    critical_v: float = 0.0

    def __post_init__(self) -> None:
        """Check the limits."""
        if self.source == "drives" and not 0.0 < self.critical_v <= self.low_v <= MAX_SUPPLY_V:
            raise InvalidValue(
                "critical_v",
                f"must be over 0 and at most low_v ({self.low_v:g}), which is at most "
                f"{MAX_SUPPLY_V:g}, where drives tell the supply, not {self.critical_v:g}",
                self.critical_v,
            )


@dataclass(frozen=True, slots=True)
class NodeParameters:
    """Required and configured settings of the nodes, before the robot may arm.

    Parameters
    ----------
    rate_hz
        Rate of the control loop and so of SYNC [Hz].
    command_timeout_ms
        Written to the drives and read back [ms]: 10 to 1000, at least two control periods.
    heartbeat_timeout_ms
        A node silent for longer is lost [ms].
    sonars
        Sonars the ring must have, 0 to 16; with 0 the sonar node is not needed.
    imu
        Whether there must be an IMU.
    power
        Who tells the supply: with `node` there must be a battery monitor.
    """

    rate_hz: int
    command_timeout_ms: int
    heartbeat_timeout_ms: int
    sonars: int
    imu: bool = False
    power: PowerConfig = PowerConfig()

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 1 <= self.rate_hz <= 10_000:
            raise InvalidValue("rate_hz", f"must be 1 to 10000, not {self.rate_hz}", self.rate_hz)
        if not 10 <= self.command_timeout_ms <= 1000:
            raise InvalidValue(
                "command_timeout_ms",
                f"must be 10 to 1000, not {self.command_timeout_ms}",
                self.command_timeout_ms,
            )
        if self.command_timeout_ms * self.rate_hz < 2000:
            raise InvalidValue(
                "command_timeout_ms",
                f"must be at least two control periods ({2000 / self.rate_hz:g} ms), not "
                f"{self.command_timeout_ms}",
                self.command_timeout_ms,
            )
        if self.heartbeat_timeout_ms <= 0:
            raise InvalidValue(
                "heartbeat_timeout_ms",
                f"must be positive, not {self.heartbeat_timeout_ms}",
                self.heartbeat_timeout_ms,
            )
        if not 0 <= self.sonars <= 16:
            raise InvalidValue("sonars", f"must be 0 to 16, not {self.sonars}", self.sonars)
