"""All parameters; a new one is a line here.

Names follow ArduRover's where that has the same value, so that its tools find them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robotctl.mavlink.parameters.parameter import Change, Parameter

_ANY, _LOWER, _HIGHER = Change.ANY, Change.LOWER, Change.HIGHER


def _wheel(letter: str, name: str) -> Iterator[Parameter]:
    """Yield the gains of one wheel's loop."""
    yield Parameter(f"CTL_{letter}_KP", f"control.{name}.kp", 0.0, 100.0, _ANY)
    yield Parameter(f"CTL_{letter}_KI", f"control.{name}.ki", 0.0, 1000.0, _ANY)
    yield Parameter(f"CTL_{letter}_KD", f"control.{name}.kd", 0.0, 10.0, _ANY)
    yield Parameter(f"CTL_{letter}_KV", f"control.{name}.kv", 0.0, 100.0, _ANY)
    yield Parameter(f"CTL_{letter}_KS", f"control.{name}.ks", 0.0, 48.0, _ANY)
    yield Parameter(f"CTL_{letter}_KA", f"control.{name}.ka", 0.0, 10.0, _ANY)
    yield Parameter(f"CTL_{letter}_D_FILT", f"control.{name}.derivative_filter_s", 0.0, 1.0, _ANY)
    yield Parameter(f"CTL_{letter}_TRACK", f"control.{name}.tracking_s", 0.0, 10.0, _ANY)


PARAMETERS: Final[tuple[Parameter, ...]] = (
    Parameter("SYSID_THISMAV", "mavlink.system_id", 1, 255),
    Parameter("SYSID_MYGCS", "mavlink.gcs_system_id", 1, 255),
    # The wheels' loops.
    *_wheel("L", "left"),
    *_wheel("R", "right"),
    *_wheel("D", "drive"),
    Parameter("PWM_DEADBAND", "control.pwm.deadband", 0.0, 0.5),
    Parameter("PWM_SLEW", "control.pwm.slew_per_s", 1.0, 1000.0),
    Parameter("PWM_MAX_DUTY", "control.pwm.max_duty", 0.05, 1.0),
    Parameter("PWM_MIN_BUS", "control.pwm.min_bus_voltage_v", 1.0, 60.0),
    # Limits of the body velocity.
    Parameter("LIM_V_MAX", "limits.v_max_m_s", 0.01, 20.0, _LOWER),
    Parameter("LIM_OMEGA_MAX", "limits.omega_max_rad_s", 0.01, 20.0, _LOWER),
    Parameter("LIM_A_MAX", "limits.a_max_m_s2", 0.05, 50.0),
    Parameter("LIM_ALPHA_MAX", "limits.alpha_max_rad_s2", 0.05, 500.0),
    Parameter("LIM_JERK_MAX", "limits.jerk_max_m_s3", 0.1, 10_000.0),
    Parameter("LIM_ANG_JERK", "limits.angular_jerk_max_rad_s3", 0.1, 100_000.0),
    # Speeds of navigation.
    Parameter("CRUISE_SPEED", "navigation.guided_speed_m_s", 0.01, 20.0, _ANY),
    Parameter("RTL_SPEED", "navigation.return_speed_m_s", 0.01, 20.0, _ANY),
    Parameter("LOOK_SPEED", "navigation.look_around_speed_m_s", 0.01, 2.0, _ANY),
    # The obstacle guard.
    Parameter("GRD_MARGIN", "navigation.guard.margin_m", 0.01, 5.0, _HIGHER),
    Parameter("GRD_DECEL", "navigation.guard.deceleration_m_s2", 0.05, 20.0, _LOWER),
    Parameter("GRD_REACTION", "navigation.guard.reaction_s", 0.02, 5.0, _HIGHER),
    Parameter("GRD_CONE", "navigation.guard.cone_deg", 1.0, 90.0, _HIGHER),
    Parameter("GRD_BLOCKED", "navigation.guard.blocked_max_s", 0.5, 3600.0, _ANY),
    Parameter("GRD_NOSE", "navigation.guard.nose_m", 0.01, 5.0),
    Parameter("GRD_HALF_WIDTH", "navigation.guard.half_width_m", 0.01, 5.0),
    # Following paths.
    Parameter("PUR_LOOK_TIME", "navigation.pursuit.lookahead_s", 0.05, 10.0, _ANY),
    Parameter("PUR_LOOK_MIN", "navigation.pursuit.lookahead_min_m", 0.05, 10.0, _ANY),
    Parameter("PUR_LOOK_MAX", "navigation.pursuit.lookahead_max_m", 0.05, 20.0, _ANY),
    Parameter("PUR_ACCEL", "navigation.pursuit.acceleration_m_s2", 0.02, 20.0, _ANY),
    Parameter("PUR_LAT_ACCEL", "navigation.pursuit.lateral_acceleration_m_s2", 0.02, 20.0, _ANY),
    Parameter("PUR_OMEGA_MAX", "navigation.pursuit.omega_max_rad_s", 0.05, 20.0, _ANY),
    Parameter("PUR_ALPHA", "navigation.pursuit.alpha_rad_s2", 0.05, 100.0, _ANY),
    Parameter("PUR_CREEP", "navigation.pursuit.creep_m_s", 0.01, 1.0, _ANY),
    Parameter("PUR_GOAL_TOL", "navigation.pursuit.goal_tolerance_m", 0.005, 5.0, _ANY),
    Parameter("PUR_OFF_PATH", "navigation.pursuit.off_path_max_m", 0.05, 20.0, _ANY),
    Parameter("PUR_TURN_FROM", "navigation.pursuit.turn_on_spot_deg", 1.0, 180.0, _ANY),
    Parameter("PUR_TURN_TO", "navigation.pursuit.turned_deg", 0.5, 90.0, _ANY),
    # Following walls.
    Parameter("WALL_LENGTH", "navigation.wall.length_m", 0.05, 10.0, _ANY),
    Parameter("WALL_OMEGA_MAX", "navigation.wall.omega_max_rad_s", 0.05, 20.0, _ANY),
    Parameter("WALL_APPROACH", "navigation.wall.approach_max_deg", 1.0, 89.0, _ANY),
    Parameter("WALL_LOST", "navigation.wall.lost_max_m", 0.05, 20.0, _ANY),
    # Driving by plan.
    Parameter("PLAN_MARGIN", "navigation.pilot.margin_m", 0.0, 5.0),
    # The body.
    Parameter("BODY_STATE", "body.state", 0, 31, _ANY),
    # Making maps.
    Parameter("MAP_PAUSE", "localisation.paused", 0, 1, _ANY),
    # Failsafes.
    Parameter("FS_GCS_TIMEOUT", "mavlink.gcs_timeout_s", 1.0, 60.0),
    Parameter("FS_GCS_HOLD", "mavlink.hold_on_gcs_loss", 0, 1),
    Parameter("FS_GCS_NEEDED", "mavlink.hold_without_gcs", 0, 1),
    Parameter("FS_SETPOINT", "mavlink.setpoint_timeout_s", 0.2, 1.0, _LOWER),
    Parameter("SAF_CMD_MS", "safety.command_timeout_ms", 10, 1000),
    Parameter("SAF_FB_PERIODS", "safety.feedback_timeout_periods", 2, 10),
    # The ages of reports: at least two and a half of their periods in `robot.dbc`.
    Parameter("SAF_STATUS_MS", "safety.status_timeout_ms", 50, 1000),
    Parameter("SAF_BATT_MS", "safety.battery_timeout_ms", 250, 5000),
    Parameter("SAF_SONAR_MS", "safety.sonar_timeout_ms", 125, 1000),
    Parameter("SAF_IMU_MS", "safety.imu_timeout_ms", 50, 1000),
    Parameter("SAF_BEAT_MS", "safety.heartbeat_timeout_ms", 250, 5000),
    Parameter("SAF_SETPOINT_MS", "safety.setpoint_timeout_ms", 50, 2000),
    Parameter("SAF_ARM_MS", "safety.arm_timeout_ms", 200, 10_000),
    Parameter("SAF_TILT_MAX", "imu.tilt_max_deg", 5.0, 60.0),
    # What a sound motor does.
    Parameter("MON_RESISTANCE", "plausibility.resistance_ohm", 0.001, 100.0),
    Parameter("MON_BACK_EMF", "plausibility.back_emf_v_s_rad", 0.001, 100.0),
    Parameter("MON_SPD_TOL", "plausibility.speed_tolerance_rad_s", 0.01, 5.0),
    Parameter("MON_SPD_SHARE", "plausibility.speed_tolerance_share", 0.01, 0.5),
    Parameter("MON_SPD_MS", "plausibility.speed_ms", 5, 500),
    Parameter("MON_PUSH_V", "plausibility.push_v", 0.01, 10.0),
    Parameter("MON_PUSH_MS", "plausibility.push_ms", 20, 2000),
    Parameter("MON_PAIR_SHARE", "plausibility.pair_share", 0.01, 0.5),
    Parameter("MON_PAIR_MS", "plausibility.pair_ms", 20, 5000),
    Parameter("MON_STEER_TOL", "plausibility.steering_tolerance_rad", 0.01, 0.5),
    Parameter("MON_STEER_MS", "plausibility.steering_ms", 20, 2000),
    Parameter("MON_CLOCK", "plausibility.clock_share", 0.001, 0.25),
    Parameter("MON_TRAVEL", "plausibility.travel_m", 0.05, 2.0),
    # Rates of messages.
    Parameter("MSG_ATTITUDE", "mavlink.rates.attitude_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_POSITION", "mavlink.rates.position_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_ODOMETRY", "mavlink.rates.odometry_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_WHEEL_DIST", "mavlink.rates.wheel_distance_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_SONAR", "mavlink.rates.sonar_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_IMU", "mavlink.rates.imu_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_BATTERY", "mavlink.rates.battery_hz", 0.0, 100.0, _ANY),
    Parameter("MSG_STATUS", "mavlink.rates.status_hz", 0.0, 100.0, _ANY),
    # What the robot is.
    Parameter("GEO_TRACK", "drive.track_width_m", 0.01, 5.0, Change.NEVER),
    Parameter("GEO_WHEELBASE", "drive.wheelbase_m", 0.01, 5.0, Change.NEVER),
    Parameter("GEO_WHEEL_R", "drive.wheel_radius_m", 0.005, 2.0, Change.NEVER),
    Parameter("GEO_COUNTS", "drive.counts_per_revolution", 1, 1_000_000, Change.NEVER),
    Parameter("CTL_RATE", "runtime.rate_hz", 1, 10_000, Change.NEVER),
    Parameter("NAV_RATE", "navigation.rate_hz", 1.0, 1000.0, Change.NEVER),
)
"""Parameters in the order of their indices; a robot has those that its file has keys for."""
