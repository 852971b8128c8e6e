"""After any fault at any time: stopped until armed again on purpose, and then no jump."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import (
    Arm,
    BatteryFeedback,
    BusState,
    BusStatus,
    ControlRequest,
    EmergencyStop,
    EmergencyStopSource,
    SafetyState,
)
from robotctl.safety.state_machine import LATCHED, POWERED
from tests.core.robot_double import PERIOD_NS, RobotDouble

DT_S = PERIOD_NS * 1e-9
LIMITS = LimitsConfig()
FIRST_V = LIMITS.jerk_max_m_s3 * DT_S * DT_S
FIRST_OMEGA = LIMITS.angular_jerk_max_rad_s3 * DT_S * DT_S
FIRST_DUTY = 40.0 * DT_S
"""The greatest first steps of set-points and duty that the limits allow."""

EMPTY = BatteryFeedback(0, 11.0, 1.0, 0.0, 25, low=True, critical=True)
FULL = BatteryFeedback(0, 12.0, 1.0, 0.8, 25, low=False, critical=False)


def setting(name: str, value: object) -> Callable[[RobotDouble], None]:
    return lambda robot: setattr(robot, name, value)


def reboot(robot: RobotDouble) -> None:
    robot.boots += 1


def stop_on_bus(robot: RobotDouble) -> None:
    robot.bus_stop = EmergencyStopSource.OPERATOR
    robot.motor_state = DriveState.EMERGENCY_STOP


def stop_by_request(robot: RobotDouble) -> None:
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.GROUND_STATION))


def freeze_heartbeat(robot: RobotDouble) -> None:
    robot.heartbeat_ns = robot.now_ns


FAULTS = {
    "wheels mute": setting("mute_wheels", True),
    "latch frozen": setting("frozen_latch", True),
    "status mute": setting("mute_status", True),
    "battery mute": setting("mute_battery", True),
    "sonars mute": setting("mute_sonars", True),
    "sonar broken": setting("sonar_m", (math.nan,) * 4),
    "heartbeat frozen": freeze_heartbeat,
    "bus off": setting("bus", BusStatus(state=BusState.BUS_OFF)),
    "bus down": setting("bus", BusStatus(state=BusState.DOWN)),
    "node lost": setting("problem", "drive (node 1): no heartbeat"),
    "node rebooted": reboot,
    "drive timed out": setting("motor_state", DriveState.STOPPED),
    "drive fault": setting("motor_state", DriveState.FAULT),
    "battery empty": setting("battery", EMPTY),
    "stop on the bus": stop_on_bus,
    "stop by request": stop_by_request,
}


def heal(robot: RobotDouble) -> None:
    """Remove every cause; the drive's own latch stays for the arming to clear."""
    robot.mute_wheels = robot.mute_status = robot.mute_battery = robot.mute_sonars = False
    robot.frozen_latch = False
    robot.heartbeat_ns = None
    robot.sonar_m = (2.0, math.inf, 2.0, 2.0)
    robot.bus = BusStatus()
    robot.problem = ""
    robot.battery = FULL


WISHES = st.sampled_from(["drive", "nothing", "disarm", "arm of before"])


def wish(robot: RobotDouble, kind: str, before_ns: int) -> list[ControlRequest]:
    """What other processes may say that is no new request to arm."""
    if kind == "drive":
        return [robot.velocity(0.5, -1.0)]
    if kind == "disarm":
        return [Arm(robot.now_ns, 98, arm=False)]
    if kind == "arm of before":
        return [Arm(before_ns, 97, arm=True)]
    return []


def assert_stopped(robot: RobotDouble) -> None:
    command = robot.outputs.command
    assert robot.state not in POWERED
    assert command == ActuatorCommand(enable=False, brake=True)


@pytest.mark.parametrize("name", FAULTS)
@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 120),
    st.floats(-0.5, 0.5),
    st.floats(-2.0, 2.0),
    st.integers(0, 60),
    st.lists(WISHES, min_size=20, max_size=120),
)
def test_a_fault_at_any_time_stops_until_armed_again_and_arming_does_not_jump(
    name: str,
    driven: int,
    v_m_s: float,
    omega_rad_s: float,
    healed_after: int,
    wishes: list[str],
) -> None:
    robot = RobotDouble().armed()
    robot.ticks(driven, (v_m_s, omega_rad_s))
    before_ns = robot.now_ns
    FAULTS[name](robot)
    for _ in range(110):
        if robot.state in LATCHED:
            break
        robot.tick(robot.velocity(v_m_s, omega_rad_s))
    assert robot.state in LATCHED
    assert_stopped(robot)
    for step, kind in enumerate(wishes):
        if step == healed_after:
            heal(robot)
        robot.tick(*wish(robot, kind, before_ns))
        assert_stopped(robot)
        assert robot.state in LATCHED
    heal(robot)
    robot.ticks(15)
    assert_stopped(robot)
    assert_no_jump(robot)


def assert_no_jump(robot: RobotDouble) -> None:
    """Arm; the first set-point is the present velocity, the first duty next to none."""
    robot.arm(5)
    for _ in range(200):
        if robot.state in POWERED:
            break
        assert_stopped(robot)
        robot.tick(robot.velocity(0.5, -1.0))
    first, command = robot.snapshot(), robot.outputs.command
    assert first.state in POWERED, first.acks
    assert abs(first.v_ref_m_s - first.v_m_s) <= FIRST_V * 1.001
    assert abs(first.omega_ref_rad_s - first.omega_rad_s) <= FIRST_OMEGA * 1.001
    assert max(map(abs, command.values)) <= FIRST_DUTY * 1.001


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 150), st.floats(-0.5, 0.5), st.floats(-1.5, 1.5))
def test_arming_while_the_robot_still_rolls_takes_over_its_velocity(
    driven: int, v_m_s: float, omega_rad_s: float
) -> None:
    robot = RobotDouble().armed()
    robot.ticks(driven, (v_m_s, omega_rad_s))
    robot.motor_state = DriveState.STOPPED
    robot.tick()
    assert robot.state == SafetyState.FAULT
    robot.motor_state = DriveState.READY
    robot.tick()
    assert_no_jump(robot)
