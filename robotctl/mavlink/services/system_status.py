"""SYS_STATUS: which parts are there, which work, and how busy the robot is."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState, SafetyState
from robotctl.messages.mavlink_port import Message

_MOTORS = common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
_BATTERY = common.MAV_SYS_STATUS_SENSOR_BATTERY
_SONARS = common.MAV_SYS_STATUS_SENSOR_PROXIMITY
_IMU = common.MAV_SYS_STATUS_SENSOR_3D_GYRO | common.MAV_SYS_STATUS_SENSOR_3D_ACCEL
_SOUND_STATES = (SafetyState.STANDBY, SafetyState.ARMED, SafetyState.DRIVING)


class SystemStatus(Microservice):
    """Sends sensor health; all of it fails while control is silent."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message with its configured rate."""
        rate_hz = self._context.config.rates.status_hz
        return (Stream(common.MAVLINK_MSG_ID_SYS_STATUS, self._build, rate_hz),)

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return system_status(control, self._context.robot)


def system_status(state: ControlState | None, robot: TelemetryRobot) -> list[Message]:
    """Return SYS_STATUS; without a state everything is present and nothing healthy.

    `errors_count1` to 3 are CAN error frames, failed CAN sends and overruns of the control loop.
    """
    present = _MOTORS | _BATTERY | (_SONARS if robot.sonars else 0) | (_IMU if robot.has_imu else 0)
    if state is None:
        unknown = (0, frames.UINT16_MAX, -1, -1, 0, 0, 0, 0, 0, 0)
        return [common.MAVLink_sys_status_message(present, present, 0, *unknown)]
    battery, bus, loop = state.battery, state.bus, state.loop
    received = bus.received + bus.lost
    return [
        common.MAVLink_sys_status_message(
            present,
            present,
            _health(state) & present,
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


def _health(state: ControlState) -> int:
    """Return the bits of working sensors."""
    health = 0
    if state.state in _SOUND_STATES:
        health |= _MOTORS
    if state.battery is not None and not state.battery.critical:
        health |= _BATTERY
    if not any(math.isnan(range_m) for range_m in state.sonar_m):
        health |= _SONARS
    if state.imu is not None:
        health |= _IMU
    return health
