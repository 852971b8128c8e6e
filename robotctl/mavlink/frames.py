"""The one conversion between our frames and units and MAVLink's.

Ours: `world` is x east, y north, z up (ENU); `base` is x forward, y left, z up (FLU); SI.
MAVLink: local NED (x north, y east, z down) and body FRD (x forward, y right, z down); SI floats in
motion messages, scaled integers in status messages.

ENU to NED swaps x and y, FLU to FRD negates y; both negate z. Yaw counts from north to the right
instead of from east to the left, so yaw_ned = pi/2 - theta and both directions are the same
formula. Scaled integers saturate at the limits of their field, never at its value for "unknown".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from robotctl.model.geometry.angles import wrap_angle

UINT16_MAX = 0xFFFF
INT16_MAX = 0x7FFF
UINT32_MAX = 0xFFFF_FFFF
STANDARD_GRAVITY_M_S2 = 9.80665
LARGEST_FLOAT = 3.0e38
"""Largest value that fits the 32 bit floats of MAVLink."""

ROTATION_CUSTOM = 100
"""MAV_SENSOR_ROTATION_CUSTOM."""


class North(NamedTuple):
    """The horizontal part of a vector in local NED."""

    north: float
    east: float


class East(NamedTuple):
    """The horizontal part of a vector in `world` (ENU)."""

    x: float
    y: float


def ned_from_enu(x: float, y: float) -> North:
    """Turn a vector of `world` into local NED [same unit]."""
    return North(north=y, east=x)


def enu_from_ned(north: float, east: float) -> East:
    """Turn a vector of local NED into `world` [same unit]."""
    return East(x=east, y=north)


def base_from_frd(forward: float, right: float) -> tuple[float, float]:
    """Turn the horizontal part of a vector of body FRD into (x, y) of `base` [same unit]."""
    return forward, -right


def yaw_ned_from_theta(theta_rad: float) -> float:
    """Return the NED yaw of a heading in `world` [rad], in (-pi, pi]."""
    return wrap_angle(math.pi / 2.0 - theta_rad)


def theta_from_yaw_ned(yaw_rad: float) -> float:
    """Return the heading in `world` of a NED yaw [rad], in (-pi, pi]."""
    return wrap_angle(math.pi / 2.0 - yaw_rad)


def yaw_rate_frd_from_omega(omega_rad_s: float) -> float:
    """Return the yaw rate about z down [rad/s], positive to the right."""
    return -omega_rad_s


def omega_from_yaw_rate_frd(yaw_rate_rad_s: float) -> float:
    """Return the yaw rate about z up [rad/s], positive to the left."""
    return -yaw_rate_rad_s


def velocity_ned(v_m_s: float, theta_rad: float) -> North:
    """Return in local NED the velocity [m/s] of a robot that drives forward at `theta_rad`."""
    return ned_from_enu(v_m_s * math.cos(theta_rad), v_m_s * math.sin(theta_rad))


def quaternion_from_yaw_ned(yaw_rad: float) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of the rotation by `yaw_rad` about z down."""
    return (math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0))


POSE_ROW = 6
"""Order of a pose in MAVLink: x, y, z, roll, pitch, yaw."""
_X, _Y, _YAW = 0, 1, 5
_PLANAR = ((_Y, 1.0), (_X, 1.0), (_YAW, -1.0))
"""Place and sign in local NED of our x, y and theta: x is east, and yaw counts the other way."""


def _upper(row: int, column: int, size: int) -> int:
    """Return the index of an element in the upper triangle of a matrix, row by row."""
    row, column = min(row, column), max(row, column)
    return row * size - row * (row - 1) // 2 + column - row


def pose_covariance_ned(covariance: Sequence[float]) -> list[float]:
    """Return MAVLink's 21 values of a planar pose's covariance in local NED.

    `covariance` is the upper triangle of (x, y, theta) in `world`, row by row. What the robot's
    plane does not know of, z, roll and pitch, is nan.
    """
    values = [math.nan] * (POSE_ROW * (POSE_ROW + 1) // 2)
    for i, (row, row_sign) in enumerate(_PLANAR):
        for j, (column, column_sign) in enumerate(_PLANAR):
            value = covariance[_upper(i, j, len(_PLANAR))]
            values[_upper(row, column, POSE_ROW)] = row_sign * column_sign * value
    return values


def pose_covariance_enu(values: Sequence[float]) -> tuple[float, ...]:
    """Return the upper triangle of (x, y, theta) in `world` from MAVLink's 21; () if unknown.

    Unknown is a variance that is no number or not positive, as MAVLink has it.
    """
    if len(values) != POSE_ROW * (POSE_ROW + 1) // 2:
        return ()
    if not all(0.0 < values[_upper(place, place, POSE_ROW)] < math.inf for place, _ in _PLANAR):
        return ()
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    found = []
    for i, j in pairs:
        (row, row_sign), (column, column_sign) = _PLANAR[i], _PLANAR[j]
        value = row_sign * column_sign * values[_upper(row, column, POSE_ROW)]
        found.append(value if math.isfinite(value) else 0.0)
    return tuple(found)


class Frd(NamedTuple):
    """A vector in body FRD."""

    forward: float
    right: float
    down: float


def frd_from_flu(x: float, y: float, z: float) -> Frd:
    """Turn a vector, or rates of turn, of `base` into body FRD [same unit]."""
    return Frd(forward=x, right=-y, down=-z)


class Euler(NamedTuple):
    """Roll, pitch and yaw of FRD in local NED, turned in the order yaw, pitch, roll [rad]."""

    roll: float
    pitch: float
    yaw: float


def euler_ned(roll_rad: float, pitch_rad: float, theta_rad: float) -> Euler:
    """Return the attitude in local NED of one in `world`, turned in the order theta, pitch, roll.

    Ours: left side up, nose down, to the left [rad]. MAVLink's: right side down, nose up, to the
    right.
    """
    return Euler(roll_rad, -pitch_rad, yaw_ned_from_theta(theta_rad))


def quaternion_from_euler(euler: Euler) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of the rotation by yaw, pitch and roll."""
    cr, sr = math.cos(euler.roll / 2.0), math.sin(euler.roll / 2.0)
    cp, sp = math.cos(euler.pitch / 2.0), math.sin(euler.pitch / 2.0)
    cy, sy = math.cos(euler.yaw / 2.0), math.sin(euler.yaw / 2.0)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


class SensorRotation(NamedTuple):
    """MAV_SENSOR_ORIENTATION of a sensor; the quaternion (w, x, y, z) only where it is custom."""

    orientation: int
    quaternion: tuple[float, float, float, float]


def sensor_rotation(heading_rad: float) -> SensorRotation:
    """Return the orientation of a level sensor with heading `heading_rad` in `base` [rad].

    Multiples of 45 degrees have a number (MAV_SENSOR_ROTATION_YAW_*, counted to the right);
    others are custom.
    """
    yaw_rad = wrap_angle(-heading_rad)
    eighths = yaw_rad / (math.pi / 4.0)
    nearest = round(eighths)
    if math.isclose(eighths, nearest, abs_tol=1e-6):
        return SensorRotation(nearest % 8, (0.0, 0.0, 0.0, 0.0))
    return SensorRotation(ROTATION_CUSTOM, quaternion_from_yaw_ned(yaw_rad))


def stick_turn(axis: int) -> float:
    """Return the turn to the left in [-1, 1] of a stick axis in [-1000, 1000], positive right."""
    return -axis / 1000.0


def fit(*values: float) -> bool:
    """Return whether all values are finite and fit a 32 bit float."""
    return all(abs(value) < LARGEST_FLOAT for value in values)


def boot_ms(stamp_ns: int) -> int:
    """Return monotonic time as the 32 bit milliseconds of MAVLink, which roll over."""
    return (stamp_ns // 1_000_000) & UINT32_MAX


def boot_us(stamp_ns: int) -> int:
    """Return monotonic time in microseconds."""
    return stamp_ns // 1000


def millivolts(voltage_v: float) -> int:
    """Return [mV], 0 to 65534; 65535 if it is not known (nan)."""
    return _scaled(voltage_v, 1e3, 0, UINT16_MAX - 1, UINT16_MAX)


def milligravities(acceleration_m_s2: float) -> int:
    """Return [mG], -32768 to 32767; 0 if it is not known (nan)."""
    return _scaled(acceleration_m_s2, 1e3 / STANDARD_GRAVITY_M_S2, -INT16_MAX - 1, INT16_MAX, 0)


def milliradians(rate_rad_s: float) -> int:
    """Return [mrad/s], -32768 to 32767; 0 if it is not known (nan)."""
    return _scaled(rate_rad_s, 1e3, -INT16_MAX - 1, INT16_MAX, 0)


def centiamperes(current_a: float) -> int:
    """Return [cA], -32768 to 32767 without -1 A/100, which means unknown (nan)."""
    value = _scaled(current_a, 1e2, -INT16_MAX - 1, INT16_MAX, -1)
    return -2 if value == -1 and not math.isnan(current_a) else value


def centidegrees_celsius(temperature_c: float) -> int:
    """Return [cdegC], -32768 to 32766; 32767 if it is not known (nan)."""
    return _scaled(temperature_c, 1e2, -INT16_MAX - 1, INT16_MAX - 1, INT16_MAX)


def percent(share: float) -> int:
    """Return a share [0, 1] as 0 to 100; -1 if it is not known (nan)."""
    return _scaled(share, 1e2, 0, 100, -1)


def per_mille(share: float) -> int:
    """Return a share as 0 to 1000; 0 if it is not known (nan)."""
    return _scaled(share, 1e3, 0, 1000, 0)


def per_ten_thousand(share: float) -> int:
    """Return a share as 0 to 10000; 0 if it is not known (nan)."""
    return _scaled(share, 1e4, 0, 10_000, 0)


def centimetres(distance_m: float) -> int:
    """Return [cm], 0 to 65535."""
    return _scaled(distance_m, 1e2, 0, UINT16_MAX, 0)


def counter_u16(count: int) -> int:
    """Return an error count that sticks at 65535."""
    return max(0, min(count, UINT16_MAX))


def _scaled(value: float, scale: float, low: int, high: int, unknown: int) -> int:
    """Round `value * scale` into [low, high]; nan becomes `unknown`."""
    if math.isnan(value):
        return unknown
    return round(max(float(low), min(value * scale, float(high))))
