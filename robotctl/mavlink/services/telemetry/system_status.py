"""SYS_STATUS: which parts are there, which work, and how busy the robot is.

| bit | healthy while |
|---|---|
| MOTOR_OUTPUTS | the robot is not stopped by a fault or an emergency stop |
| BATTERY | the battery reports, and is not critical |
| PROXIMITY, OBSTACLE_AVOIDANCE | all sonars work; the second is enabled in the modes of the guard |
| 3D_GYRO, 3D_ACCEL | the IMU reports |
| AHRS | the robot knows its pose |
| PREARM_CHECK | the robot is armed, or nothing speaks against arming |
| GEOFENCE | the robot is not beyond its fence; without one, too, or MAVProxy cries breach |
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState, Mode, SafetyState
from robotctl.messages.fence import FenceState
from robotctl.messages.mavlink_port import Message
from robotctl.safety.state_machine import ENABLED

_MOTORS = common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
_BATTERY = common.MAV_SYS_STATUS_SENSOR_BATTERY
_SONARS = common.MAV_SYS_STATUS_SENSOR_PROXIMITY
_IMU = common.MAV_SYS_STATUS_SENSOR_3D_GYRO | common.MAV_SYS_STATUS_SENSOR_3D_ACCEL
_POSE = common.MAV_SYS_STATUS_AHRS
_PREARM = common.MAV_SYS_STATUS_PREARM_CHECK
_GUARD = common.MAV_SYS_STATUS_OBSTACLE_AVOIDANCE
_FENCE = common.MAV_SYS_STATUS_GEOFENCE
_GUARDED = frozenset({Mode.AUTO, Mode.RTL, Mode.GUIDED})
_SOUND_STATES = frozenset({SafetyState.STANDBY}) | ENABLED


class SystemStatus(Microservice):
    """Sends sensor health; all of it fails while control is silent, but the fence."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message with its configured rate."""
        rate_hz = self._context.config.rates.status_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_SYS_STATUS,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_EXTENDED_STATUS,
            ),
        )

    def _build(self, now_ns: int) -> list[Message]:
        context = self._context
        navigation = context.navigation  # a fence stays, though navigation may be silent
        found = Found(
            knows_pose=context.known_pose(now_ns) is not None,
            can_arm=not context.against_arming(now_ns),
            is_guarded=context.mode(now_ns) in _GUARDED,
            fence=FenceState() if navigation is None else navigation.fence,
        )
        return system_status(context.fresh_control(now_ns), context.robot, found)


class Found(NamedTuple):
    """Summary of the other processes' states."""

    knows_pose: bool
    can_arm: bool
    is_guarded: bool
    fence: FenceState = FenceState()


def system_status(state: ControlState | None, robot: TelemetryRobot, found: Found) -> list[Message]:
    """Return SYS_STATUS; without a state everything is present and nothing healthy.

    `errors_count1` to 3 are CAN error frames, failed CAN sends and overruns of the control loop.
    """
    present = _MOTORS | _BATTERY | _POSE | _PREARM
    present |= (_SONARS | _GUARD if robot.sonars else 0) | (_IMU if robot.has_imu else 0)
    present |= _FENCE if found.fence.crc else 0
    enabled = present if found.is_guarded else present & ~_GUARD
    enabled &= -1 if found.fence.enabled else ~_FENCE
    fence = 0 if found.fence.breached else _FENCE
    if state is None:
        unknown = (0, frames.UINT16_MAX, -1, -1, 0, 0, 0, 0, 0, 0)
        return [common.MAVLink_sys_status_message(present, enabled, fence, *unknown)]
    battery, bus, loop = state.battery, state.bus, state.loop
    received = bus.received + bus.lost
    return [
        common.MAVLink_sys_status_message(
            present,
            enabled,
            _health(state, found) & present | fence,
            frames.per_mille(loop.step_us_p50 * 1e-6 * loop.rate_hz),
            frames.millivolts(battery.voltage_v if battery else math.nan),
            frames.centiamperes(battery.current_a if battery else math.nan),
            frames.percent(battery.charge if battery else math.nan),
            frames.per_ten_thousand(bus.lost / received if received > 0 else 0.0),
            frames.counter_u16(bus.crc_rejects + bus.counter_rejects + bus.lost),
            frames.counter_u16(bus.error_frames),
            frames.counter_u16(bus.send_failures),
            frames.counter_u16(loop.overruns),
            0,
        )
    ]


def _health(state: ControlState, found: Found) -> int:
    """Return the bits of what works."""
    health = (_POSE if found.knows_pose else 0) | (_PREARM if found.can_arm else 0)
    if state.state in _SOUND_STATES:
        health |= _MOTORS
    if state.battery is not None and not state.battery.critical:
        health |= _BATTERY
    if not any(math.isnan(range_m) for range_m in state.sonar_m):
        health |= _SONARS | _GUARD
    if state.imu is not None:
        health |= _IMU
    return health
