"""ATTITUDE(_QUATERNION), LOCAL_POSITION_NED and ODOMETRY: where the robot is and how it moves."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.mavlink_port import Message
from robotctl.model.geometry.se2 import SE2

_UNKNOWN_COVARIANCE = [math.nan] * 21


class Poses(Microservice):
    """Sends `base` in `world`; nothing while it is unknown."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._epoch: tuple[int, int] | None = None
        self._resets = 0

    def streams(self) -> tuple[Stream, ...]:
        """Return the messages with their configured rates; ATTITUDE_QUATERNION to who asks."""
        rates = self._context.config.rates
        return (
            Stream(
                common.MAVLINK_MSG_ID_ATTITUDE,
                self._attitude,
                rates.attitude_hz,
                common.MAV_DATA_STREAM_EXTRA1,
            ),
            Stream(
                common.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
                self._position,
                rates.position_hz,
                common.MAV_DATA_STREAM_POSITION,
            ),
            Stream(common.MAVLINK_MSG_ID_ODOMETRY, self._odometry, rates.odometry_hz),
            Stream(common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, self._quaternion, 0.0),
        )

    def step(self, now_ns: int) -> None:  # noqa: ARG002
        """Count the jumps of the pose in `world`."""
        control, world = self._context.control, self._context.world
        if control is not None and world.pose(control) is not None:
            epoch = world.epoch(control)
            self._resets += self._epoch not in {None, epoch}
            self._epoch = epoch

    def _attitude(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        return [] if found is None else attitude(*found)

    def _quaternion(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        return [] if found is None else attitude_quaternion(*found)

    def _position(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        return [] if found is None else local_position(*found)

    def _odometry(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        if found is None:
            return []
        return odometry(*found, self._context.fresh_fix(now_ns), self._resets)


def attitude(state: ControlState, pose: SE2) -> list[Message]:
    """Return ATTITUDE: level without an IMU; empty if the heading is not a number."""
    if not frames.fit(pose.theta_rad, state.omega_rad_s):
        return []
    euler, rates = _attitude(state, pose)
    return [common.MAVLink_attitude_message(frames.boot_ms(state.stamp_ns), *euler, *rates)]


def attitude_quaternion(state: ControlState, pose: SE2) -> list[Message]:
    """Return ATTITUDE_QUATERNION, as `attitude`."""
    if not frames.fit(pose.theta_rad, state.omega_rad_s):
        return []
    euler, rates = _attitude(state, pose)
    return [
        common.MAVLink_attitude_quaternion_message(
            frames.boot_ms(state.stamp_ns), *frames.quaternion_from_euler(euler), *rates
        )
    ]


def _attitude(state: ControlState, pose: SE2) -> tuple[frames.Euler, frames.Frd]:
    """Return attitude and rates of turn [rad, rad/s] by the IMU; without one, by the wheels."""
    imu = state.imu
    if imu is None:
        rates = frames.frd_from_flu(0.0, 0.0, state.omega_rad_s)
        return frames.euler_ned(0.0, 0.0, pose.theta_rad), rates
    true = (rate - bias for rate, bias in zip(imu.rate_rad_s, imu.bias_rad_s, strict=True))
    euler = frames.euler_ned(imu.roll_rad, imu.pitch_rad, pose.theta_rad)
    return euler, frames.frd_from_flu(*true)


def local_position(state: ControlState, pose: SE2) -> list[Message]:
    """Return LOCAL_POSITION_NED; empty if the pose is not a number."""
    if not frames.fit(pose.x_m, pose.y_m, pose.theta_rad, state.v_m_s):
        return []
    position = frames.ned_from_enu(pose.x_m, pose.y_m)
    velocity = frames.velocity_ned(state.v_m_s, pose.theta_rad)
    return [
        common.MAVLink_local_position_ned_message(
            frames.boot_ms(state.stamp_ns),
            position.north,
            position.east,
            0.0,
            velocity.north,
            velocity.east,
            0.0,
        )
    ]


def odometry(
    state: ControlState, pose: SE2, localisation: LocalisationState | None, reset_counter: int
) -> list[Message]:
    """Return ODOMETRY: pose in local NED, velocity in body FRD.

    The covariance of the pose is the localiser's; while that does not vouch for the pose, and
    without one, it is not known.
    """
    if not frames.fit(pose.x_m, pose.y_m, pose.theta_rad, state.v_m_s, state.omega_rad_s):
        return []
    position = frames.ned_from_enu(pose.x_m, pose.y_m)
    euler, rates = _attitude(state, pose)
    return [
        common.MAVLink_odometry_message(
            frames.boot_us(state.stamp_ns),
            common.MAV_FRAME_LOCAL_NED,
            common.MAV_FRAME_BODY_FRD,
            position.north,
            position.east,
            0.0,
            frames.quaternion_from_euler(euler),
            state.v_m_s,
            0.0,
            0.0,
            *rates,
            _UNKNOWN_COVARIANCE
            if localisation is None
            else frames.pose_covariance_ned(localisation.covariance),
            _UNKNOWN_COVARIANCE,
            reset_counter & 0xFF,
            common.MAV_ESTIMATOR_TYPE_NAIVE
            if localisation is None
            else common.MAV_ESTIMATOR_TYPE_AUTOPILOT,
            0,
        )
    ]
