"""Messages read back from our own logs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import msgspec

from robotctl.logs.mcap.foxglove import OUT_OF_RANGE_M
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class LoggedState:
    """Used fields of a control state.

    Parameters
    ----------
    stamp_ns
        Time by the robot's clock [ns].
    T_odom_base
        Pose of the odometry.
    sonar_m
        Last range of each sonar [m]; inf: no echo, nan: no valid reading.
    sonar_stamp_ns
        Arrival time of each [ns].
    corrected_rad
        Contribution of its gyro to the odometry's turn so far [rad]; None without gyro data.
    odom_epoch_ns
        Start of the odometry's frame [ns].
    """

    stamp_ns: int
    T_odom_base: SE2
    sonar_m: tuple[float, ...] = ()
    sonar_stamp_ns: tuple[int, ...] = ()
    corrected_rad: float | None = None
    odom_epoch_ns: int = 0


@dataclass(frozen=True, slots=True)
class LoggedBelief:
    """Used fields of the localiser: a `LocalisationStatus`, and the pose."""

    status: int
    T_world_odom: SE2


@dataclass(frozen=True, slots=True)
class LoggedScan:
    """Scan of the lidar, which is at `x_m`, `y_m` of `base` [m, rad]."""

    x_m: float
    y_m: float
    first_rad: float
    last_rad: float
    max_range_m: float
    ranges_m: tuple[float, ...]
    name: str = ""
    sweep_s: float = 0.0


@dataclass(frozen=True, slots=True)
class LoggedView:
    """View of the camera: angle [rad], range and its sigma [m] of each beam."""

    x_m: float
    y_m: float
    max_range_m: float
    beams: tuple[tuple[float, float, float], ...]


class _Pose(msgspec.Struct):
    x_m: float
    y_m: float
    theta_rad: float

    def value(self) -> SE2:
        """Return it as a pose."""
        return SE2(self.x_m, self.y_m, self.theta_rad)


class _Sonar(msgspec.Struct):
    stamp_ns: int
    out_of_range: bool = False
    range_m: float = math.nan

    def reading_m(self) -> float:
        """Return the range [m]; inf: no echo, nan: no valid reading."""
        return math.inf if self.out_of_range else self.range_m


class _Imu(msgspec.Struct):
    corrected_rad: float = 0.0


class _State(msgspec.Struct):
    stamp_ns: int
    T_odom_base: _Pose
    sonars: list[_Sonar] = []
    imu: _Imu | None = None
    odom_epoch_ns: int = 0


class _Belief(msgspec.Struct):
    status: int
    T_world_odom: _Pose


class _Beam(msgspec.Struct):
    angle_rad: float
    out_of_range: bool = False
    range_m: float = math.nan
    sigma_m: float = math.nan


class _View(msgspec.Struct):
    x_m: float
    y_m: float
    max_range_m: float
    beams: list[_Beam]
    trouble: str = ""


class _Place(msgspec.Struct):
    x: float
    y: float


class _LaserPose(msgspec.Struct):
    position: _Place


class _Laser(msgspec.Struct):
    pose: _LaserPose
    start_angle: float
    end_angle: float
    max_range: float
    ranges: list[float]
    name: str = ""
    sweep_s: float = 0.0


_STATE: Final = msgspec.json.Decoder(_State)
_BELIEF: Final = msgspec.json.Decoder(_Belief)
_VIEW: Final = msgspec.json.Decoder(_View)
_LASER: Final = msgspec.json.Decoder(_Laser)


def logged_state(data: bytes) -> LoggedState:
    """Return a message of the topic `control`; raises `msgspec.DecodeError` if invalid."""
    state = _STATE.decode(data)
    return LoggedState(
        state.stamp_ns,
        state.T_odom_base.value(),
        tuple(each.reading_m() for each in state.sonars),
        tuple(each.stamp_ns for each in state.sonars),
        None if state.imu is None else state.imu.corrected_rad,
        state.odom_epoch_ns,
    )


def is_outdated(data: bytes) -> bool:
    """Return whether a message of the topic `control` is of a version before 0.1.0."""
    return b'"theta_rad"' in data and b'"T_odom_base"' not in data


def logged_belief(data: bytes) -> LoggedBelief:
    """Return a message of the topic `localisation`; raises as `logged_state`."""
    belief = _BELIEF.decode(data)
    return LoggedBelief(belief.status, belief.T_world_odom.value())


def logged_scan(data: bytes) -> LoggedScan:
    """Return a message of the topic `lidar`; raises as `logged_state`."""
    laser = _LASER.decode(data)
    place = laser.pose.position
    return LoggedScan(
        place.x,
        place.y,
        laser.start_angle,
        laser.end_angle,
        laser.max_range,
        tuple(map(_range_m, laser.ranges)),
        laser.name,
        laser.sweep_s,
    )


def logged_view(data: bytes) -> LoggedView | None:
    """Return a message of the topic `camera`, None in trouble; raises as `logged_state`."""
    view = _VIEW.decode(data)
    if view.trouble:
        return None
    beams = tuple(
        (each.angle_rad, math.inf if each.out_of_range else each.range_m, each.sigma_m)
        for each in view.beams
    )
    return LoggedView(view.x_m, view.y_m, view.max_range_m, beams)


def _range_m(written: float) -> float:
    """Return a range of a scan [m]; inf: no echo, nan: no valid reading."""
    if written >= OUT_OF_RANGE_M:
        return math.inf
    return math.nan if written <= -OUT_OF_RANGE_M else written
