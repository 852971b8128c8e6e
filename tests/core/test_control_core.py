"""The control core in closed loop with ideal wheels: it drives, and it stops."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.pid import PidConfig
from robotctl.core.config import ControlConfig
from robotctl.drivers.can.nodes.motor import WheelFeedback
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import (
    Arm,
    BatteryFeedback,
    BusState,
    BusStatus,
    EmergencyMessage,
    EmergencyStop,
    EmergencyStopSource,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from tests.core.robot_double import PERIOD_NS, RobotDouble


def test_it_boots_to_standby_and_arms_on_request_only() -> None:
    robot = RobotDouble()
    robot.ticks(100, (0.5, 0.0))
    assert robot.state == SafetyState.STANDBY
    assert robot.outputs.command.enable is False
    robot.arm(request_id=42)
    assert robot.state == SafetyState.ARMED
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (42, True)


def test_it_reaches_the_velocity_it_is_told_and_integrates_its_way() -> None:
    robot = RobotDouble().armed()
    robot.ticks(400, (0.5, 0.0))
    state = robot.snapshot()
    assert robot.state == SafetyState.DRIVING
    assert state.v_m_s == pytest.approx(0.5, rel=0.01)
    true_m = 0.05 * sum(robot.angles) / 2
    assert state.x_m - 1.0 == pytest.approx(true_m, abs=2e-4)
    assert state.y_m == pytest.approx(2.0, abs=1e-3)
    assert state.distance_m == pytest.approx(true_m, abs=2e-4)


def test_positive_omega_turns_left() -> None:
    robot = RobotDouble().armed()
    robot.ticks(200, (0.0, 1.0))
    state = robot.snapshot()
    assert state.theta_rad > 0.5
    assert robot.angles[1] > 0.5 > 0 > -0.5 > robot.angles[0]


def test_a_set_point_expires_and_the_robot_comes_to_rest_by_itself() -> None:
    robot = RobotDouble().armed()
    robot.ticks(200, (0.5, 0.0))
    robot.ticks(800)
    assert robot.state == SafetyState.ARMED
    assert robot.speeds == pytest.approx([0.0, 0.0], abs=1e-3)
    assert robot.snapshot().duty == (0.0, 0.0)


Break = Callable[[RobotDouble], None]


def mute_wheels(robot: RobotDouble) -> None:
    robot.mute_wheels = True


def mute_status(robot: RobotDouble) -> None:
    robot.mute_status = True


def bus_off(robot: RobotDouble) -> None:
    robot.bus = BusStatus(state=BusState.BUS_OFF)


def lose_node(robot: RobotDouble) -> None:
    robot.problem = "drive (node 1): no heartbeat"


def reboot_node(robot: RobotDouble) -> None:
    robot.boots += 1


def drive_timeout(robot: RobotDouble) -> None:
    robot.motor_state = DriveState.STOPPED


def drive_fault(robot: RobotDouble) -> None:
    robot.motor_state = DriveState.FAULT
    robot.faults = 1


def empty_battery(robot: RobotDouble) -> None:
    robot.battery = BatteryFeedback(0, 9.0, 1.0, 0.0, 25, True, True)


@pytest.mark.parametrize(
    ("damage", "within_ticks", "code"),
    [
        (mute_wheels, 4, FaultCode.WHEELS_STALE),
        (mute_status, 41, FaultCode.MOTOR_STALE),
        (bus_off, 1, FaultCode.BUS_OFF),
        (lose_node, 1, FaultCode.NODE_REFUSED),
        (reboot_node, 1, FaultCode.NODE_RESTARTED),
        (drive_timeout, 1, FaultCode.DRIVE_STOPPED),
        (drive_fault, 1, FaultCode.DRIVE_OVER_CURRENT),
        (empty_battery, 1, FaultCode.BATTERY_CRITICAL),
    ],
)
def test_each_fault_stops_within_its_time_and_latches(
    damage: Break, within_ticks: int, code: FaultCode
) -> None:
    robot = RobotDouble().armed()
    robot.ticks(100, (0.5, 0.0))
    damage(robot)
    for _ in range(within_ticks):
        robot.tick(robot.velocity(0.5, 0.0))
    assert robot.state == SafetyState.FAULT
    assert robot.snapshot().fault == code, robot.snapshot().reason
    assert robot.outputs.command.enable is False
    assert robot.outputs.command.values == ()
    robot.mute_wheels = robot.mute_status = False
    robot.bus, robot.problem, robot.faults = BusStatus(), "", 0
    robot.motor_state = DriveState.READY
    robot.battery = BatteryFeedback(0, 12.0, 1.0, 0.8, 25, False, False)
    robot.ticks(200, (0.5, 0.0))
    assert robot.state == SafetyState.FAULT
    assert max(map(abs, robot.speeds)) < 0.01


def test_feedback_that_comes_again_in_time_does_not_stop() -> None:
    robot = RobotDouble().armed()
    robot.ticks(100, (0.5, 0.0))
    for _ in range(20):
        robot.mute_wheels = True
        robot.ticks(3, (0.5, 0.0))
        robot.mute_wheels = False
        robot.ticks(1, (0.5, 0.0))
    assert robot.state == SafetyState.DRIVING


@pytest.mark.parametrize("way", ["request", "bus"])
def test_an_emergency_stop_acts_in_its_tick_and_only_arming_ends_it(way: str) -> None:
    robot = RobotDouble().armed()
    robot.ticks(100, (0.5, 0.0))
    if way == "request":
        outputs = robot.tick(EmergencyStop(0, EmergencyStopSource.GROUND_STATION))
        assert outputs.emergency_stop == EmergencyStopSource.GROUND_STATION
    else:
        robot.bus_stop = EmergencyStopSource.OPERATOR
        outputs = robot.tick()
    assert outputs.command.enable is False
    assert robot.state == SafetyState.EMERGENCY_STOP
    robot.motor_state = DriveState.EMERGENCY_STOP
    robot.ticks(100, (0.5, 0.0))
    assert robot.state == SafetyState.EMERGENCY_STOP
    robot.arm()
    robot.ticks(3)
    assert robot.state == SafetyState.ARMED
    assert robot.motor_state == DriveState.ENABLED


@pytest.mark.parametrize("way", ["request before", "request behind", "bus"])
def test_an_emergency_stop_wins_over_a_request_to_arm_in_the_same_tick(way: str) -> None:
    robot = RobotDouble().armed()
    robot.tick(EmergencyStop(0, EmergencyStopSource.OPERATOR))
    robot.motor_state = DriveState.EMERGENCY_STOP
    robot.ticks(10)
    arm = Arm(robot.now_ns, 77, arm=True)
    stop = EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR)
    if way == "bus":
        robot.bus_stop = EmergencyStopSource.OPERATOR
        robot.tick(arm)
    else:
        robot.tick(*((stop, arm) if way == "request before" else (arm, stop)))
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (77, False)
    robot.ticks(300, (0.5, 0.0))
    assert robot.state == SafetyState.EMERGENCY_STOP


def test_a_request_to_arm_made_before_the_stop_does_not_end_it_however_late_it_comes() -> None:
    robot = RobotDouble().armed()
    late = Arm(robot.now_ns, 78, arm=True)
    robot.ticks(2)
    robot.tick(EmergencyStop(0, EmergencyStopSource.OPERATOR))
    robot.motor_state = DriveState.EMERGENCY_STOP
    robot.ticks(2)
    robot.tick(late)
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (78, False)
    before = "made before the stop: emergency stop (operator)"
    assert ack.reasons == (Fault(FaultCode.REQUEST_BEFORE_STOP, before),)
    robot.ticks(300, (0.5, 0.0))
    assert robot.state == SafetyState.EMERGENCY_STOP


def test_a_refused_arming_says_every_reason() -> None:
    robot = RobotDouble()
    robot.mute_status = True
    robot.battery = BatteryFeedback(0, 10.0, 1.0, 0.1, 25, True, False)
    robot.ticks(3)
    robot.arm(5)
    robot.ticks(250)
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (5, False)
    codes = {reason.code for reason in ack.reasons}
    assert {FaultCode.MOTOR_STALE, FaultCode.DRIVE_STALE, FaultCode.BATTERY_LOW} <= codes
    assert robot.state == SafetyState.STANDBY


def test_asking_again_and_again_does_not_put_off_the_refusal() -> None:
    robot = RobotDouble()
    robot.mute_status = True
    robot.ticks(3)
    for request_id in range(1, 31):
        robot.arm(request_id)
        robot.ticks(9)
    ack = robot.snapshot().acks[-1]
    assert not ack.accepted
    assert ack.request_id >= 20


def test_an_old_request_to_arm_is_refused() -> None:
    robot = RobotDouble()
    robot.ticks(3)
    robot.tick(Arm(robot.now_ns - 2_000_000_000, 6, arm=True))
    robot.ticks(3)
    assert robot.state == SafetyState.STANDBY
    ack = robot.snapshot().acks[-1]
    assert not ack.accepted


def test_disarming_in_motion_brakes() -> None:
    robot = RobotDouble().armed()
    robot.ticks(100, (0.5, 0.0))
    outputs = robot.disarm()
    assert robot.state == SafetyState.STANDBY
    assert (outputs.command.enable, outputs.command.brake) == (False, True)


def test_a_stop_and_an_arming_within_one_tick_show_in_the_count_of_armings() -> None:
    robot = RobotDouble().armed()
    assert robot.snapshot().armings == 1
    robot.tick(Arm(robot.now_ns, 8, arm=False), Arm(robot.now_ns, 9, arm=True))
    assert robot.state == SafetyState.ARMED
    assert robot.snapshot().armings == 2
    robot.arm(10)
    assert robot.snapshot().armings == 2


def test_a_velocity_wanted_before_the_arming_is_not_driven_however_late_it_comes() -> None:
    robot = RobotDouble().armed()
    before = robot.velocity(0.5, 0.0)
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR))
    robot.ticks(5)
    robot.arm(2)
    robot.ticks(1)
    assert robot.state == SafetyState.ARMED
    assert robot.now_ns < before.expires_ns
    robot.tick(before)
    assert robot.state == SafetyState.ARMED
    assert robot.snapshot().v_ref_m_s == 0.0
    robot.tick(robot.velocity(0.5, 0.0))
    assert robot.state == SafetyState.DRIVING


@pytest.mark.parametrize("stop", ["disarmed", "fault", "never armed"])
def test_a_drive_that_goes_on_without_being_told_to_is_stopped_by_the_emergency_stop(
    stop: str,
) -> None:
    robot = RobotDouble()
    robot.ticks(110)
    if stop != "never armed":
        robot.armed()
    if stop == "fault":
        robot.boots += 1
        robot.tick()
        assert robot.state == SafetyState.FAULT
    elif stop == "disarmed":
        robot.disarm()
    limit_ns = robot.now_ns + (robot.core._safety.command_timeout_ms + 50) * 1_000_000
    if stop == "never armed":
        limit_ns = 0
    robot.motor_state = robot.drive_says = DriveState.ENABLED
    while robot.now_ns + PERIOD_NS <= limit_ns - PERIOD_NS:
        assert robot.tick().emergency_stop is None
    stops = [robot.tick().emergency_stop for _ in range(3)]
    assert stops[-1] is EmergencyStopSource.HOST_FAULT
    assert robot.state == SafetyState.EMERGENCY_STOP
    assert robot.snapshot().reason == (
        "emergency stop: the motor controller is enabled without a command"
    )


def test_a_frame_that_was_held_back_is_no_way_and_no_feedback() -> None:
    robot = RobotDouble().armed()
    robot.ticks(100, (0.4, 0.0))
    left, right = next(i.feedback.actuators for _, i, _ in reversed(robot.record[:-80]))
    old = WheelFeedback(0, left.latch_us, (left.position_ticks, right.position_ticks))
    before, angles = robot.snapshot(), list(robot.angles)
    robot.held_back = old
    robot.tick(robot.velocity(0.4, 0.0))
    after = robot.snapshot()
    assert (after.x_m, after.wheel_rad_s) == (before.x_m, before.wheel_rad_s)
    robot.ticks(20, (0.4, 0.0))
    assert robot.state == SafetyState.DRIVING
    way_m = [0.05 * (now - then) for now, then in zip(robot.angles, angles, strict=True)]
    assert robot.snapshot().x_m - before.x_m == pytest.approx(sum(way_m) / 2, abs=0.0005)


@pytest.mark.parametrize(("node", "told"), [((1, "drive"), 1), ((3, "power"), 0)])
def test_a_drive_that_restarts_loses_its_counts_and_says_so(
    node: tuple[int, str], told: int
) -> None:
    robot = RobotDouble()
    robot.node = node
    robot.armed()
    robot.boots += 1
    before = robot.snapshot().odom_epoch_ns
    texts = [notice.text for notice in robot.tick().notices]
    text = "the drive restarted or was silent: its motion meanwhile is not in the pose"
    assert texts.count(text) == told
    assert (robot.snapshot().odom_epoch_ns != before) == told
    after = robot.snapshot().odom_epoch_ns
    robot.ticks(20)
    assert robot.snapshot().odom_epoch_ns == after
    assert robot.state == SafetyState.FAULT


def test_what_a_node_reports_is_told_once_between_two_armings() -> None:
    robot = RobotDouble()

    def told(*codes: int) -> list[str]:
        robot.emergencies = tuple(EmergencyMessage(robot.now_ns, 1, code, 1) for code in codes)
        texts = [notice.text for notice in robot.tick().notices]
        robot.emergencies = ()
        return [text for text in texts if "error" in text]

    robot.ticks(1)
    assert told(0x6310, 0x6310, 0x3220) == [
        "drive (node 1) reports error 0x6310: stored parameters are lost",
        "drive (node 1) reports error 0x3220: under voltage",
    ]
    assert told(0, 0x6310) == []
    robot.armed()
    assert told(0x6310) == ["drive (node 1) reports error 0x6310: stored parameters are lost"]


@settings(max_examples=30)
@given(st.integers(1, 150), st.floats(-0.6, 0.6), st.floats(-1.5, 1.5))
def test_arming_again_in_motion_starts_from_the_present_speed(
    fault_tick: int, v_m_s: float, omega_rad_s: float
) -> None:
    robot = RobotDouble().armed()
    robot.ticks(fault_tick, (v_m_s, omega_rad_s))
    robot.motor_state = DriveState.STOPPED
    robot.tick()
    robot.motor_state = DriveState.READY
    robot.tick()
    robot.arm()
    after = robot.snapshot()
    assert robot.state == SafetyState.ARMED
    limit_v = 2.5 * PERIOD_NS * 1e-9 + 0.02
    assert abs(after.v_ref_m_s - after.v_m_s) <= limit_v
    assert abs(after.omega_ref_rad_s - after.omega_rad_s) <= 10 * PERIOD_NS * 1e-9 + 0.1


def test_sonar_ranges_land_at_their_index() -> None:
    robot = RobotDouble().armed()
    robot.sonar_m = (1.0, math.inf, 2.5, 3.0)
    robot.ticks(10)
    assert robot.snapshot().sonar_m == (1.0, math.inf, 2.5, 3.0)


def test_loops_must_fit_the_wheels() -> None:
    with pytest.raises(ValueError, match=r"control\.right: missing"):
        ControlConfig(left=PidConfig()).loops(("left", "right"))
    with pytest.raises(ValueError, match=r"control\.left: this drive has no such wheel"):
        ControlConfig(left=PidConfig(), drive=PidConfig()).loops(("drive",))


@pytest.mark.parametrize("speed_m_s", [-1.5, 1.5])
def test_the_way_of_a_robot_that_is_pushed_counts(speed_m_s: float) -> None:
    robot = RobotDouble()
    robot.ticks(10)
    before = robot.snapshot()
    for _ in range(100):
        robot.angles = [angle + speed_m_s / 0.05 * PERIOD_NS * 1e-9 for angle in robot.angles]
        robot.tick()
    after = robot.snapshot()
    assert after.x_m - before.x_m == pytest.approx(speed_m_s * 100 * PERIOD_NS * 1e-9, abs=2e-4)


def test_counts_that_no_wheel_of_this_robot_can_make_are_no_way() -> None:
    # LimitsConfig() and RobotDouble: 0.5 m/s and 2 rad/s on a track of 0.3 m are 0.8 m/s at a
    # wheel; at most 2 x 0.8 + 1.5 = 3.1 m/s, 15.5 mm in a period of 5 ms.
    robot = RobotDouble()
    robot.ticks(10)
    before = robot.snapshot()
    robot.angles[0] += 0.020 / 0.05
    robot.ticks(10)
    assert robot.snapshot().distance_m == before.distance_m
    robot.angles[0] += 0.014 / 0.05
    robot.ticks(10)
    assert robot.snapshot().distance_m - before.distance_m == pytest.approx(0.007, abs=2e-4)


@pytest.mark.parametrize("source", EmergencyStopSource)
def test_a_stop_is_passed_on_with_its_source_whatever_that_is(source: EmergencyStopSource) -> None:
    robot = RobotDouble().armed()
    robot.ticks(20, (0.3, 0.0))
    outputs = robot.tick(EmergencyStop(robot.now_ns, source))
    assert outputs.emergency_stop is source
    assert robot.tick().emergency_stop is None


def test_monitors_compare_what_came_with_the_command_that_the_bridges_had_then() -> None:
    """SYNC latches the encoders a tick earlier, when the bridges had the command before that."""
    robot = RobotDouble().armed()
    supervision, seen = robot.core._supervision, []
    compare = supervision.compare

    def watched(feedback, command, motion) -> None:  # type: ignore[no-untyped-def]
        seen.append(command)
        compare(feedback, command, motion)

    supervision.compare = watched  # type: ignore[method-assign]
    begin = len(robot.record)
    robot.ticks(50, (0.4, 0.3))
    commands = [outputs.command for _, _, outputs in robot.record]
    assert seen == commands[begin - 2 : -2]
    assert len({command.values for command in seen}) > 10
