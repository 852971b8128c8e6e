"""Check of the IMU: at rest it measures gravity and no rotation."""

from __future__ import annotations

import math
from typing import Final

from robotctl.deploy.check_result import Finding, fail, ok
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.estimation.inertial.tracker import GRAVITY_M_S2, REST_RAD_S, InertialTracker
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import ImuFeedback
from robotctl.messages.ports import Clock
from robotctl.model.sensors.imu import ImuConfig

LOOK_NS: Final = 1_000_000_000
"""Duration of the measurement [ns]."""

GRAVITY_TOLERANCE: Final = 0.05
"""Maximum error of a sound accelerometer at rest [share of gravity]."""


def watch_imu(
    robot: CanRobot, clock: Clock, period_ns: int, imu: ImuConfig, off: ActuatorCommand
) -> ImuFeedback | None:
    """Tick with the motors off for `LOOK_NS`; return the IMU's feedback then, None without any."""
    tracker = InertialTracker(imu)
    deadline_ns = clock.now_ns()
    end_ns = deadline_ns + LOOK_NS
    while deadline_ns < end_ns:
        deadline_ns += period_ns
        clock.sleep_until(deadline_ns)
        now_ns = clock.now_ns()
        feedback = robot.receive(now_ns)
        tracker.update(feedback.gyro, feedback.accelerometer, 0.0, 0.0)
        robot.send(off, now_ns)
    return tracker.latest


def check_imu(imu: ImuFeedback | None, config: ImuConfig) -> Finding:
    """Check the IMU of a robot at rest."""
    check = "IMU"
    if imu is None:
        return fail(check, "sends no readings", "check its power and cable")
    force_m_s2 = math.hypot(*imu.force_m_s2)
    tilt_deg, rate_rad_s = math.degrees(imu.tilt_rad), max(map(abs, imu.rate_rad_s))
    found = (
        f"feels {force_m_s2:.2f} m/s^2, is tilted by {tilt_deg:.0f} degrees, "
        f"turns by {rate_rad_s:.3f} rad/s"
    )
    if abs(force_m_s2 - GRAVITY_M_S2) > GRAVITY_TOLERANCE * GRAVITY_M_S2:
        return fail(check, found, "leave the robot alone meanwhile, or replace the IMU")
    if tilt_deg > config.tilt_max_deg:
        fix = "stand the robot upright, and mount the IMU with its z axis up"
        return fail(check, found, fix)
    if rate_rad_s > REST_RAD_S:
        return fail(check, found, "leave the robot alone meanwhile, or replace the IMU")
    return ok(check, found)
