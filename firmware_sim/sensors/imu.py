"""The inertial measurement unit: gyro and accelerometer."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from firmware_sim.config.parameters import ImuMount, ImuParameters
from firmware_sim.nodes.imu import ImuSample, Vector

GRAVITY_M_S2: Final = 9.80665


class BodyMotion(NamedTuple):
    """Pose of base in world [m, rad], its velocity forward and to the left [m/s], turn [rad/s]."""

    x_m: float
    y_m: float
    theta_rad: float
    v_m_s: float
    vy_m_s: float
    omega_rad_s: float


class Tilt(NamedTuple):
    """Motion of the robot out of the plane, by the floor or a hand.

    Roll about x and pitch about y of base [rad], right-handed, and upward acceleration [m/s^2].
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    lift_m_s2: float = 0.0


LEVEL: Final = Tilt()


class Imu:
    """Measures gravity, the acceleration of its mounting point, and all rotation.

    Gyro and accelerometer have a constant bias drawn from the seed, and white noise; the floor
    shakes the accelerometer in proportion to the robot's speed.

    Parameters
    ----------
    parameters
        Parameters of the sensor.
    mount
        Pose of the sensor in base.
    rng
        Generator of biases and noise.
    """

    def __init__(
        self, parameters: ImuParameters, mount: ImuMount, rng: np.random.Generator
    ) -> None:
        self._parameters = parameters
        self._mount = mount
        self._rng = rng
        self.gyro_bias_rad_s = rng.normal(0.0, 1.0, 3) * parameters.gyro_bias_rad_s
        self.force_bias_m_s2 = rng.normal(0.0, 1.0, 3) * parameters.force_bias_m_s2
        self._before: tuple[int, BodyMotion, Tilt] | None = None

    def sample(self, now_ns: int, motion: BodyMotion, tilt: Tilt = LEVEL) -> ImuSample:
        """Return the means since the last sample, from the motion at both times."""
        before_ns, before, before_tilt = self._before or (now_ns, motion, tilt)
        self._before = now_ns, motion, tilt
        dt_s = (now_ns - before_ns) * 1e-9
        turn_rad = math.remainder(motion.theta_rad - before.theta_rad, math.tau)
        middle_rad = before.theta_rad + 0.5 * turn_rad
        ax, ay, roll, pitch, yaw = 0.0, 0.0, 0.0, 0.0, motion.omega_rad_s
        if dt_s > 0.0:
            now_x, now_y = self._velocity_world(motion)
            then_x, then_y = self._velocity_world(before)
            ax, ay = _turned((now_x - then_x) / dt_s, (now_y - then_y) / dt_s, -middle_rad)
            yaw = turn_rad / dt_s
            roll = (tilt.roll_rad - before_tilt.roll_rad) / dt_s
            pitch = (tilt.pitch_rad - before_tilt.pitch_rad) / dt_s
        fx, fy, fz = _tilted((ax, ay, GRAVITY_M_S2 + tilt.lift_m_s2), tilt)
        mount_rad = -math.radians(self._mount.yaw_deg)
        rx, ry, rz = _body_rates(roll, pitch, yaw, tilt)
        rate = (*_turned(rx, ry, mount_rad), rz)
        force = (*_turned(fx, fy, mount_rad), fz)
        p = self._parameters
        shaking = math.hypot(p.force_sigma_m_s2, p.vibration_m_s2_per_m_s * motion.v_m_s)
        return ImuSample(
            self._disturbed(rate, self.gyro_bias_rad_s, p.gyro_sigma_rad_s),
            self._disturbed(force, self.force_bias_m_s2, shaking),
        )

    def _velocity_world(self, motion: BodyMotion) -> tuple[float, float]:
        """Return the velocity in world of the sensor's mounting point [m/s]."""
        v_x = motion.v_m_s - motion.omega_rad_s * self._mount.y_m
        v_y = motion.vy_m_s + motion.omega_rad_s * self._mount.x_m
        return _turned(v_x, v_y, motion.theta_rad)

    def forget(self) -> None:
        """Reset: the robot has been moved."""
        self._before = None

    def _disturbed(self, true: Vector, bias: np.ndarray, sigma: float) -> Vector:
        x, y, z = (np.array(true) + bias + self._rng.normal(0.0, sigma, 3)).tolist()
        return x, y, z


def _turned(x: float, y: float, angle_rad: float) -> tuple[float, float]:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * x - s * y, s * x + c * y


def _body_rates(roll: float, pitch: float, yaw: float, tilt: Tilt) -> Vector:
    """Return the rates about the body's axes for rates of roll, pitch and yaw (ISO 1151-2)."""
    sin_roll, cos_roll = math.sin(tilt.roll_rad), math.cos(tilt.roll_rad)
    level = yaw * math.cos(tilt.pitch_rad)
    return (
        roll - yaw * math.sin(tilt.pitch_rad),
        pitch * cos_roll + level * sin_roll,
        level * cos_roll - pitch * sin_roll,
    )


def _tilted(vector: Vector, tilt: Tilt) -> Vector:
    """Return a vector of the level frame in the axes of a robot pitched, then rolled."""
    x, y, z = vector
    c, s = math.cos(tilt.pitch_rad), math.sin(tilt.pitch_rad)
    x, z = c * x - s * z, s * x + c * z
    c, s = math.cos(tilt.roll_rad), math.sin(tilt.roll_rad)
    return x, c * y + s * z, -s * y + c * z
