"""Attitude, turning and rising of the robot by its IMU, with the wheels as witnesses.

Attitude is the direction of "up" in `base`: the gyro turns it, and the accelerometer pulls it
slowly to where the floor pushes (a complementary filter: Mahony, Hamel and Pflimlin, IEEE TAC
53(5), 2008, the explicit form). What the robot feels of its own circles is taken off before.

It fails where the robot speeds up for seconds on end, as nothing tells that from a slope.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from robotctl.messages.control import AccelerometerFeedback, GyroFeedback, ImuFeedback
from robotctl.model.sensors.imu import ImuConfig

GRAVITY_M_S2: Final = 9.80665

GRAVITY_TOLERANCE: Final = 0.05
"""A scale or bias that is more off is no accelerometer's [share of gravity]."""

TILT_S: Final = 1.5
"""Time in which the accelerometer corrects the attitude [s]: braking takes less."""

STEADY_M_S2: Final = 2.0
"""Forces that differ by more from gravity say nothing of the attitude [m/s^2]."""

RISE_S: Final = 0.6
"""Memory of the vertical speed [s]: without end it would collect the accelerometer's bias."""

SLIP_S: Final = 2.0
"""Memory of the difference between gyro and wheels [s]."""

GAP_S: Final = 0.1
"""A longer pause between two frames is one of the IMU [s]: the rotation meanwhile is unknown."""

REST_S: Final = 0.5
"""Time without rotation after which wheels are at rest [s]."""

REST_RAD_S: Final = 0.1
"""A gyro that reads more does not stand, whatever its bias [rad/s]."""

STILL_RAD_S: Final = 0.03
"""Nor does one that reads so much more than its known bias [rad/s]."""

BIAS_S: Final = 2.0
"""Memory of the bias [s]."""

BIAS_READINGS: Final = 10
"""Readings at rest after which the bias is known."""

BIAS_SIGMA_RAD_S: Final = 0.02
"""How well it is known after one, three times the noise and more [rad/s]; by the root of their
number better after more,"""

BIAS_FINEST_RAD_S: Final = 0.001
"""but not better than this: it drifts [rad/s]."""

TRIFLE_RAD: Final = 0.01
"""Gyro and wheels differ by that much at any time [rad]: coarse encoders, frames of other times."""

Vector: TypeAlias = tuple[float, float, float]


class InertialTracker:
    """Follows the robot by gyro and accelerometer.

    Parameters
    ----------
    mount
        Where the IMU sits.

    Attributes
    ----------
    latest
        The present estimate; None before the first frames of both sensors.
    """

    def __init__(self, mount: ImuConfig) -> None:
        self.latest: ImuFeedback | None = None
        yaw_rad = math.radians(mount.yaw_deg)
        self._cos, self._sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self._x_m, self._y_m = mount.x_m, mount.y_m
        self._rate: Vector = (0.0, 0.0, 0.0)
        self._bias: Vector = (0.0, 0.0, 0.0)
        self._readings_at_rest = 0
        self._at_rest = False
        self._gravity_m_s2 = GRAVITY_M_S2
        """Reading of the accelerometer at rest [m/s^2]."""
        self._up: Vector | None = None
        self._ahead_rad = self._rise_m_s = self._slip_rad = self._corrected_rad = 0.0
        self._apart_rad = 0.0
        """Difference of gyro and wheels, beyond the bias and before a correction."""
        self._gyro_ns = self._force_ns = 0
        self._wheels_turned_rad = 0.0
        self._wheels_moved_ns = -round(REST_S * 1e9)

    def update(
        self,
        gyro: GyroFeedback | None,
        accelerometer: AccelerometerFeedback | None,
        v_m_s: float,
        wheels_turned_rad: float,
    ) -> float:
        """Take what a tick brought.

        Parameters
        ----------
        gyro, accelerometer
            New frames, if any.
        v_m_s
            Speed forward, by the wheels [m/s].
        wheels_turned_rad
            Total rotation so far, by the wheels [rad].

        Returns
        -------
        By how much the heading by the wheels is to be corrected [rad]: where gyro and wheels differ
        by more than the bias explains, the wheels slip ("gyrodometry": Borenstein and Feng, ICRA
        1996). 0 without a new frame, at rest, and while the gyro's bias is not known.
        """
        slip_rad = 0.0
        if gyro is not None:
            slip_rad = self._turn(gyro, v_m_s, wheels_turned_rad)
        if accelerometer is not None:
            self._push(accelerometer, v_m_s)
        return slip_rad

    def _turn(self, gyro: GyroFeedback, v_m_s: float, wheels_turned_rad: float) -> float:
        """Turn "up" by the gyro, and compare it with the wheels."""
        dt_s = (gyro.stamp_ns - self._gyro_ns) * 1e-9
        self._gyro_ns = gyro.stamp_ns
        by_wheels_rad = wheels_turned_rad - self._wheels_turned_rad
        self._wheels_turned_rad = wheels_turned_rad
        if by_wheels_rad != 0.0 or v_m_s != 0.0:
            self._wheels_moved_ns = gyro.stamp_ns
        x, y = self._in_base(gyro.x_rad_s, gyro.y_rad_s)
        rate = x, y, gyro.z_rad_s
        self._rate = rate
        if not 0.0 < dt_s <= GAP_S:
            return 0.0
        at_rest = self._at_rest = self._is_at_rest(rate)
        if at_rest:
            self._learn_bias(rate, dt_s)
        bias = self._bias
        wx, wy, wz = rate[0] - bias[0], rate[1] - bias[1], rate[2] - bias[2]
        if self._up is not None:
            ux, uy, uz = self._up  # du/dt = u x omega
            self._up = _unit(
                ux + (uy * wz - uz * wy) * dt_s,
                uy + (uz * wx - ux * wz) * dt_s,
                uz + (ux * wy - uy * wx) * dt_s,
            )
        slip_rad = wz * dt_s - by_wheels_rad
        self._ahead_rad += slip_rad
        self._slip_rad += slip_rad - self._slip_rad * dt_s / SLIP_S
        return 0.0 if at_rest else self._correction(slip_rad, dt_s)

    def _correction(self, slip_rad: float, dt_s: float) -> float:
        """Return what of the difference between gyro and wheels is slip and no bias [rad]."""
        readings = self._readings_at_rest
        if readings < BIAS_READINGS:
            return 0.0
        drift_rad = max(BIAS_SIGMA_RAD_S / math.sqrt(readings), BIAS_FINEST_RAD_S) * dt_s
        apart_rad = self._apart_rad + slip_rad
        apart_rad -= math.copysign(min(abs(apart_rad), drift_rad), apart_rad)
        self._apart_rad = max(-TRIFLE_RAD, min(apart_rad, TRIFLE_RAD))
        correction_rad = apart_rad - self._apart_rad
        self._corrected_rad += correction_rad
        return correction_rad

    def _push(self, accelerometer: AccelerometerFeedback, v_m_s: float) -> None:
        """Pull "up" to where the floor pushes, and follow what lifts or drops the robot."""
        dt_s = (accelerometer.stamp_ns - self._force_ns) * 1e-9
        self._force_ns = accelerometer.stamp_ns
        x, y = self._in_base(accelerometer.x_m_s2, accelerometer.y_m_s2)
        force = x, y, accelerometer.z_m_s2
        omega = self._rate[2] - self._bias[2]
        fx = x + omega * omega * self._x_m
        fy = y + omega * omega * self._y_m - v_m_s * omega
        fz = force[2]
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        if self._up is None or not 0.0 < dt_s <= GAP_S:
            if size == 0.0:
                return
            self._up = _unit(fx, fy, fz)
            self._rise_m_s = 0.0
            dt_s = 0.0
        up = self._up
        if abs(size - GRAVITY_M_S2) < STEADY_M_S2:
            share = dt_s / TILT_S
            up = self._up = _unit(
                up[0] + share * (fx / size - up[0]),
                up[1] + share * (fy / size - up[1]),
                up[2] + share * (fz / size - up[2]),
            )
        if self._at_rest and abs(size - GRAVITY_M_S2) < GRAVITY_TOLERANCE * GRAVITY_M_S2:
            self._gravity_m_s2 += (size - self._gravity_m_s2) * dt_s / BIAS_S
        lift_m_s2 = fx * up[0] + fy * up[1] + fz * up[2] - self._gravity_m_s2
        self._rise_m_s += lift_m_s2 * dt_s - self._rise_m_s * dt_s / RISE_S
        self.latest = ImuFeedback(
            self._force_ns,
            self._gyro_ns,
            self._rate,
            force,
            up,
            self._bias,
            self._rise_m_s,
            self._slip_rad,
            self._ahead_rad,
            self._corrected_rad,
        )

    def _is_at_rest(self, rate: Vector) -> bool:
        """Return whether wheels and gyro agree that the robot is at rest."""
        if self._gyro_ns - self._wheels_moved_ns < REST_S * 1e9:
            return False
        if max(map(abs, rate)) > REST_RAD_S:
            return False
        if self._readings_at_rest < BIAS_READINGS:
            return True
        bias = self._bias
        return max(abs(rate[0] - bias[0]), abs(rate[1] - bias[1]), abs(rate[2] - bias[2])) < (
            STILL_RAD_S
        )

    def _learn_bias(self, rate: Vector, dt_s: float) -> None:
        """Take a reading at rest for one of the bias: the mean of all, later of the last ones."""
        self._readings_at_rest += 1
        share = max(1.0 / self._readings_at_rest, dt_s / BIAS_S)
        bias = self._bias
        self._bias = (
            bias[0] + share * (rate[0] - bias[0]),
            bias[1] + share * (rate[1] - bias[1]),
            bias[2] + share * (rate[2] - bias[2]),
        )

    def take_bias(self, bias_rad_s: Vector, readings: int) -> None:
        """Take a bias that was measured [rad/s], as the mean of so many readings at rest."""
        self._bias, self._readings_at_rest = bias_rad_s, readings

    def _in_base(self, x: float, y: float) -> tuple[float, float]:
        """Turn the horizontal part of a vector of the sensor into `base`."""
        return self._cos * x - self._sin * y, self._sin * x + self._cos * y


def _unit(x: float, y: float, z: float) -> Vector:
    """Return a vector of length 1."""
    size = math.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 0.0 else (0.0, 0.0, 1.0)
