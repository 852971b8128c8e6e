"""The periodic messages, each a function of the control process's state and pose in `world`."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.service import TelemetryRobot
from robotctl.messages.control import ControlState, SafetyState
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.mavlink_port import Message
from robotctl.model.geometry.se2 import SE2

MAX_WHEELS = 16
LARGEST_FLOAT = 3.0e38
"""Beyond it a value does not fit the 32 bit floats of MAVLink."""

_NAN = float("nan")
_UNKNOWN_COVARIANCE = [_NAN] * 21
_OTHER_CELLS = [frames.UINT16_MAX] * 9
_MOTORS = common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
_BATTERY = common.MAV_SYS_STATUS_SENSOR_BATTERY
_SONARS = common.MAV_SYS_STATUS_SENSOR_PROXIMITY
_SOUND_STATES = (SafetyState.STANDBY, SafetyState.ARMED, SafetyState.DRIVING)


def attitude(state: ControlState, pose: SE2) -> list[Message]:
    """Return ATTITUDE of the level robot; empty where the heading is not a number."""
    if not _fit(pose.theta_rad, state.omega_rad_s):
        return []
    return [
        common.MAVLink_attitude_message(
            frames.boot_ms(state.stamp_ns),
            0.0,
            0.0,
            frames.yaw_ned_from_theta(pose.theta_rad),
            0.0,
            0.0,
            frames.yaw_rate_frd_from_omega(state.omega_rad_s),
        )
    ]


def local_position(state: ControlState, pose: SE2) -> list[Message]:
    """Return LOCAL_POSITION_NED; empty where the pose is not a number."""
    if not _fit(pose.x_m, pose.y_m, pose.theta_rad, state.v_m_s):
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
    if not _fit(pose.x_m, pose.y_m, pose.theta_rad, state.v_m_s, state.omega_rad_s):
        return []
    position = frames.ned_from_enu(pose.x_m, pose.y_m)
    return [
        common.MAVLink_odometry_message(
            frames.boot_us(state.stamp_ns),
            common.MAV_FRAME_LOCAL_NED,
            common.MAV_FRAME_BODY_FRD,
            position.north,
            position.east,
            0.0,
            frames.quaternion_from_yaw_ned(frames.yaw_ned_from_theta(pose.theta_rad)),
            state.v_m_s,
            0.0,
            0.0,
            0.0,
            0.0,
            frames.yaw_rate_frd_from_omega(state.omega_rad_s),
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


def wheel_distance(state: ControlState) -> list[Message]:
    """Return WHEEL_DISTANCE of the driven wheels, in the order of the drive's wheels."""
    distances = state.wheel_distance_m[:MAX_WHEELS]
    padding = [0.0] * (MAX_WHEELS - len(distances))
    return [
        common.MAVLink_wheel_distance_message(
            frames.boot_us(state.stamp_ns), len(distances), [*distances, *padding]
        )
    ]


def distance_sensors(state: ControlState, robot: TelemetryRobot) -> list[Message]:
    """Return one DISTANCE_SENSOR for each sonar that works; its number is its place.

    Where there was no echo the distance is one step above the maximum, which ground stations
    show as out of range. A least distance is not known of any sonar: it is 0.
    """
    messages = []
    most_cm = min(frames.centimetres(robot.sonar.max_range_m), frames.UINT16_MAX - 1)
    beam_rad = math.radians(robot.sonar.beam_deg)
    sonars = zip(robot.sonars, state.sonar_m, state.sonar_stamp_ns, strict=False)
    for number, (mount, range_m, stamp_ns) in enumerate(sonars):
        if math.isnan(range_m):
            continue
        rotation = frames.sensor_rotation(mount.heading_rad)
        messages.append(
            common.MAVLink_distance_sensor_message(
                frames.boot_ms(stamp_ns),
                0,
                most_cm,
                most_cm + 1 if math.isinf(range_m) else frames.centimetres(range_m),
                common.MAV_DISTANCE_SENSOR_ULTRASOUND,
                number,
                rotation.orientation,
                255,  # covariance not known
                beam_rad,
                beam_rad,
                rotation.quaternion,
                0,  # quality not known
            )
        )
    return messages


def battery_status(state: ControlState) -> list[Message]:
    """Return BATTERY_STATUS; empty where no battery was heard."""
    battery = state.battery
    if battery is None:
        return []
    charge_state = common.MAV_BATTERY_CHARGE_STATE_OK
    if battery.critical:
        charge_state = common.MAV_BATTERY_CHARGE_STATE_CRITICAL
    elif battery.low:
        charge_state = common.MAV_BATTERY_CHARGE_STATE_LOW
    return [
        common.MAVLink_battery_status_message(
            0,
            common.MAV_BATTERY_FUNCTION_ALL,
            common.MAV_BATTERY_TYPE_UNKNOWN,
            frames.centidegrees_celsius(battery.temperature_c),
            [frames.millivolts(battery.voltage_v), *_OTHER_CELLS],
            frames.centiamperes(battery.current_a),
            -1,  # consumed charge and energy are not measured
            -1,
            frames.percent(battery.charge),
            0,
            charge_state,
        )
    ]


def system_status(state: ControlState | None, robot: TelemetryRobot) -> list[Message]:
    """Return SYS_STATUS; without a state everything is present and nothing healthy.

    `errors_count1` to 3 are CAN error frames, failed CAN sends and overruns of the control loop.
    """
    present = _MOTORS | _BATTERY | (_SONARS if robot.sonars else 0)
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
            frames.millivolts(battery.voltage_v if battery else _NAN),
            frames.centiamperes(battery.current_a if battery else _NAN),
            frames.percent(battery.charge if battery else _NAN),
            frames.per_ten_thousand(bus.lost / received if received > 0 else 0.0),
            frames.counter_u16(bus.crc_rejects + bus.counter_rejects + bus.lost),
            frames.counter_u16(bus.error_frames),
            frames.counter_u16(bus.send_failures),
            frames.counter_u16(loop.overruns),
            0,
        )
    ]


def _health(state: ControlState) -> int:
    """Return the bits of what works."""
    health = 0
    if state.state in _SOUND_STATES:
        health |= _MOTORS
    if state.battery is not None and not state.battery.critical:
        health |= _BATTERY
    if not any(math.isnan(range_m) for range_m in state.sonar_m):
        health |= _SONARS
    return health


def _fit(*values: float) -> bool:
    """Return whether all values are finite and fit a 32 bit float."""
    return all(abs(value) < LARGEST_FLOAT for value in values)
