"""System status: load, errors, and parts that are present, enabled and healthy."""

import math

import pytest
from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.services.telemetry.system_status import Found, system_status
from robotctl.messages.control import (
    BusStatus,
    LoopStatistics,
    Mode,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from tests.mavlink.conftest import control_state
from tests.mavlink.services.telemetry.bench import one_of_each, tilted


def test_system_status_shows_load_and_errors_of_bus_and_loop(bench):
    bus = BusStatus(
        received=990, lost=10, crc_rejects=3, counter_rejects=4, error_frames=5, send_failures=6
    )
    loop = LoopStatistics(rate_hz=200.0, step_us_p50=500.0, overruns=7)
    status = one_of_each(bench, bus=bus, loop=loop)["SYS_STATUS"]
    assert status.load == 100  # 500 us of 5 ms
    assert status.drop_rate_comm == 100  # 1 %
    assert status.errors_comm == 17
    counts = status.errors_count1, status.errors_count2, status.errors_count3
    assert counts == (5, 6, 7)


def test_a_fault_makes_the_motors_unhealthy(bench):
    motors = common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    bench.run(0.5, state=SafetyState.STANDBY)
    assert bench.messages("SYS_STATUS")[0].onboard_control_sensors_health & motors
    bench.run(1.5, state=SafetyState.FAULT)
    assert not bench.messages("SYS_STATUS")[-1].onboard_control_sensors_health & motors


def sensors(bench, bit, **control):
    """Return whether a part is present, enabled and healthy after a second."""
    bench.run(1.02, **control)
    status = bench.messages("SYS_STATUS")[-1]
    names = ("present", "enabled", "health")
    return tuple(bool(getattr(status, f"onboard_control_sensors_{name}") & bit) for name in names)


LOW = Fault(FaultCode.BATTERY_LOW, "the battery is low")


@pytest.mark.parametrize(
    ("state", "against", "healthy"),
    [
        (SafetyState.STANDBY, (), True),
        (SafetyState.STANDBY, (LOW,), False),
        (SafetyState.FAULT, (LOW,), False),
        (SafetyState.ARMED, (), True),
        (SafetyState.DRIVING, (), True),
    ],
)
def test_the_pre_arm_bit_says_whether_arming_would_succeed(bench, state, against, healthy):
    prearm = common.MAV_SYS_STATUS_PREARM_CHECK
    found = sensors(bench, prearm, state=state, against_arming=against)
    assert found == (True, True, healthy)


def test_no_fence_is_breached_where_there_is_none(bench):
    assert sensors(bench, common.MAV_SYS_STATUS_GEOFENCE) == (False, False, True)


def test_the_pose_is_healthy_while_it_is_known(bench):
    ahrs = common.MAV_SYS_STATUS_AHRS
    assert sensors(bench, ahrs) == (True, True, True)
    assert sensors(bench, ahrs, theta_rad=math.nan) == (True, True, False)


@pytest.mark.parametrize("mode", Mode)
def test_the_guard_is_enabled_in_the_modes_in_which_it_slows_the_robot(bench, mode):
    guard = common.MAV_SYS_STATUS_OBSTACLE_AVOIDANCE
    for _ in range(60):
        bench.step(bench.control(), bench.navigation(mode=mode))
    status = bench.messages("SYS_STATUS")[-1]
    is_enabled = bool(status.onboard_control_sensors_enabled & guard)
    assert is_enabled == (mode not in {Mode.HOLD, Mode.MANUAL})
    deaf = (math.nan, *[1.0] * 7)
    assert sensors(bench, guard, sonar_m=deaf)[2] is False


@pytest.mark.parametrize(("imu", "healthy"), [(tilted(), True), (None, False)])
def test_gyro_and_accelerometer_are_present_where_the_robot_has_them(imu, healthy):
    bits = common.MAV_SYS_STATUS_SENSOR_3D_GYRO | common.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    for has_imu in (False, True):
        robot = TelemetryRobot(has_imu=has_imu)
        (message,) = system_status(control_state(0, imu=imu), robot, Found(True, True, True))
        assert message.onboard_control_sensors_present & bits == (bits if has_imu else 0)
        expected = bits if has_imu and healthy else 0
        assert message.onboard_control_sensors_health & bits == expected
