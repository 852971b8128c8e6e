"""Arming is refused with every reason, code and text, and accepted where there is none."""

from collections.abc import Callable

import msgspec
import pytest

from robotctl.app.processes.control import missing_rights
from robotctl.control.pid import PidConfig
from robotctl.core.warmup import rehearse
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import (
    Ack,
    Arm,
    BatteryFeedback,
    BusState,
    BusStatus,
    EmergencyStop,
    EmergencyStopSource,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.state_machine import SafetyConfig
from tests.core.robot_double import PERIOD_NS, WARM_TICKS, RobotDouble, make_core

LOW = BatteryFeedback(0, 10.2, 1.0, 0.1, 25, low=True, critical=False)
CRITICAL = BatteryFeedback(0, 10.1, 1.0, 0.0, 25, low=True, critical=True)
WAIT_TICKS = SafetyConfig().arm_timeout_ms * 1_000_000 // PERIOD_NS


def answer(robot: RobotDouble) -> Ack:
    robot.arm(31)
    for _ in range(WAIT_TICKS + 2):
        acks = robot.snapshot().acks
        if acks and acks[-1].request_id == 31:
            return acks[-1]
        robot.tick()
    raise AssertionError("no answer")


def setting(**values: object) -> Callable[[RobotDouble], None]:
    def damage(robot: RobotDouble) -> None:
        for name, value in values.items():
            setattr(robot, name, value)

    return damage


C = FaultCode
NO_RIGHTS = Fault(C.RIGHT_MISSING, "no rights")
REFUSED = {
    "low battery": (setting(battery=LOW), Fault(C.BATTERY_LOW, "the battery is low (10.2 V)")),
    "critical battery": (
        setting(battery=CRITICAL),
        Fault(C.BATTERY_CRITICAL, "the battery is critical (10.1 V)"),
    ),
    "no battery": (
        setting(battery=None),
        Fault(C.BATTERY_MISSING, "the battery has not reported yet"),
    ),
    "error passive": (
        setting(bus=BusStatus(state=BusState.ERROR_PASSIVE)),
        Fault(C.BUS_PASSIVE, "the CAN bus is error passive"),
    ),
    "bus off": (
        setting(bus=BusStatus(state=BusState.BUS_OFF)),
        Fault(C.BUS_OFF, "the CAN bus is bus off"),
    ),
    "bus down": (
        setting(bus=BusStatus(state=BusState.DOWN)),
        Fault(C.BUS_DOWN, "the CAN bus is down"),
    ),
    "full bus": (
        setting(bus=BusStatus(load=0.85)),
        Fault(C.BUS_FULL, "the CAN bus is 85% full, 80% allowed"),
    ),
    "unheard commands": (
        setting(command_age_ms=255),
        Fault(C.COMMAND_LOSS, "the motor controller had no valid command for 255 ms", "drive"),
    ),
    "node": (
        setting(problem="drive (node 1): wire version 7"),
        Fault(C.NODE_REFUSED, "drive (node 1): wire version 7", "drive"),
    ),
    "host": (setting(objections=(NO_RIGHTS,)), NO_RIGHTS),
}


@pytest.mark.parametrize("name", REFUSED)
def test_each_reason_alone_refuses_and_is_told_and_nothing_else_is(name: str) -> None:
    damage, reason = REFUSED[name]
    robot = RobotDouble()
    damage(robot)
    robot.ticks(WARM_TICKS)
    ack = answer(robot)
    assert not ack.accepted
    assert ack.reasons == (reason,)
    assert robot.state not in (SafetyState.ARMED, SafetyState.DRIVING)
    notice = robot.outputs.notices or [n for _, _, out in robot.record for n in out.notices]
    assert notice[-1].text == f"arming refused: {reason}"


def test_all_reasons_are_told_together() -> None:
    robot = RobotDouble()
    robot.battery = LOW
    robot.bus = BusStatus(state=BusState.ERROR_PASSIVE)
    robot.problem = "drive (node 1): lost"
    robot.objections = (NO_RIGHTS, Fault(C.RIGHT_MISSING, "no memory lock"))
    robot.mute_sonars = True
    robot.ticks(WARM_TICKS)
    reasons = answer(robot).reasons
    assert reasons[:2] == robot.objections
    codes = [reason.code for reason in reasons]
    assert codes.count(C.SONAR_STALE) == 4
    assert {C.BATTERY_LOW, C.BUS_PASSIVE, C.NODE_REFUSED} < set(codes)


def test_a_healthy_bus_with_much_traffic_or_a_warning_is_no_reason() -> None:
    robot = RobotDouble()
    robot.bus = BusStatus(state=BusState.ERROR_WARNING, load=0.8)
    robot.ticks(WARM_TICKS)
    assert answer(robot) == Ack(31, accepted=True)


def test_a_cold_loop_does_not_arm_and_says_so_and_a_warm_one_does() -> None:
    robot = RobotDouble()
    robot.ticks(WARM_TICKS - 2)
    robot.arm(1)
    assert robot.state == SafetyState.STANDBY
    robot.tick()
    assert robot.state == SafetyState.ARMED
    safety = SafetyConfig(warmup_ticks=10_000)
    cold = RobotDouble(safety)
    cold.ticks(5)
    ack = answer(cold)
    assert ack.reasons[0].code == C.NOT_WARM
    assert ack.reasons[0].text.endswith(" of 10000")


def test_a_robot_arms_as_soon_as_its_drive_hears_commands() -> None:
    robot = RobotDouble()
    robot.command_age_ms = 255
    robot.ticks(WARM_TICKS)
    robot.arm(31)
    robot.ticks(50)
    assert robot.state == SafetyState.STANDBY
    robot.command_age_ms = 1
    robot.tick()
    assert robot.state == SafetyState.ARMED


def test_a_robot_whose_drive_does_not_enable_is_stopped_100_ms_behind_arming() -> None:
    robot = RobotDouble().armed()
    robot.drive_says = DriveState.READY
    robot.ticks(20)
    assert robot.state == SafetyState.ARMED
    robot.tick()
    assert robot.state == SafetyState.FAULT
    assert robot.snapshot().fault == C.DRIVE_NOT_ENABLED


def test_objections_of_an_earlier_request_do_not_refuse_a_later_one() -> None:
    robot = RobotDouble()
    robot.objections = (NO_RIGHTS,)
    robot.ticks(WARM_TICKS)
    assert not answer(robot).accepted
    robot.objections = ()
    robot.arm(32)
    assert robot.state == SafetyState.ARMED


def test_the_rehearsal_takes_a_core_through_arming_and_leaves_other_cores_alone() -> None:
    core, other = make_core(), make_core()
    before = msgspec.structs.asdict(RobotDouble().snapshot())
    assert rehearse(core, PERIOD_NS)
    assert core.machine.state == SafetyState.EMERGENCY_STOP
    assert other.machine.state == SafetyState.BOOT
    assert repr(msgspec.structs.asdict(RobotDouble().snapshot())) == repr(before)


def test_missing_rights_speak_against_arming() -> None:
    refused = ("SCHED_FIFO priority 60 refused", "locking memory refused")
    assert missing_rights(refused) == tuple(
        Fault(
            C.RIGHT_MISSING,
            f"real-time right missing: {right} (or set runtime.allow_best_effort)",
        )
        for right in refused
    )


def test_disarming_has_no_age() -> None:
    robot = RobotDouble().armed()
    robot.ticks(300, (0.3, 0.0))
    robot.tick(Arm(robot.now_ns - 5_000_000_000, 7, arm=False))
    assert robot.state == SafetyState.STANDBY
    assert robot.snapshot().acks[-1] == Ack(7, accepted=True)
    assert not robot.outputs.command.enable


def test_each_of_two_who_ask_is_answered_the_same() -> None:
    robot = RobotDouble()
    robot.ticks(WARM_TICKS)
    robot.objections = (NO_RIGHTS,)
    first, second = (Arm(robot.now_ns, number, arm=True) for number in (4, 9))
    robot.tick(first)
    robot.tick(second)
    robot.ticks(WAIT_TICKS + 1)
    refused = (Ack(4, accepted=False, reasons=robot.objections), Ack(9, False, robot.objections))
    assert robot.snapshot().acks == refused
    robot.objections = ()
    both = (Arm(robot.now_ns, 11, arm=True), Arm(robot.now_ns, 12, arm=True))
    robot.tick(*both, Arm(robot.now_ns, 13, arm=False))
    assert robot.snapshot().acks[2:] == (
        Ack(11, False, (Fault(C.REQUEST_WITHDRAWN, "disarmed"),)),
        Ack(12, False, (Fault(C.REQUEST_WITHDRAWN, "disarmed"),)),
        Ack(13, accepted=True),
    )
    assert robot.state == SafetyState.STANDBY


def test_the_last_answers_are_kept_and_no_more() -> None:
    robot = RobotDouble()
    robot.ticks(WARM_TICKS)
    for request_id in range(100):
        robot.tick(Arm(robot.now_ns, request_id, arm=request_id % 2 == 0))
    acks = robot.snapshot().acks
    assert [ack.request_id for ack in acks] == list(range(92, 100))


@pytest.mark.parametrize(
    ("ahead_ns", "reason"),
    [
        (1, Fault(C.REQUEST_TOO_EARLY, "of the future")),
        (None, Fault(C.REQUEST_TOO_OLD, "too old")),
    ],
)
def test_a_request_to_arm_of_another_time_is_refused(ahead_ns: int | None, reason: Fault) -> None:
    robot = RobotDouble()
    robot.ticks(WARM_TICKS)
    limit_ns = -SafetyConfig().request_max_age_ms * 1_000_000
    offset_ns = limit_ns - 1 if ahead_ns is None else ahead_ns
    robot.tick(Arm(robot.now_ns + PERIOD_NS + offset_ns, 5, arm=True))
    assert robot.snapshot().acks[-1] == Ack(5, accepted=False, reasons=(reason,))
    robot.ticks(WAIT_TICKS)
    assert robot.state == SafetyState.STANDBY


def test_no_request_of_the_future_undoes_an_emergency_stop() -> None:
    robot = RobotDouble().armed()
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR))
    robot.tick(Arm(robot.now_ns + 3_600_000_000_000, 5, arm=True))
    robot.ticks(WAIT_TICKS)
    assert robot.state == SafetyState.EMERGENCY_STOP


def test_a_request_to_arm_that_a_stop_overtakes_is_answered() -> None:
    robot = RobotDouble()
    robot.ticks(WARM_TICKS)
    robot.battery = LOW  # it has to wait
    robot.arm(31)
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.OPERATOR))
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (31, False)
    assert ack.reasons[0].code == C.REQUEST_BEFORE_STOP
    assert "emergency stop" in ack.reasons[0].text


@pytest.mark.parametrize(
    ("gains", "refused"),
    [
        (PidConfig(), True),
        (PidConfig(kd=0.1, ks=0.3, ka=0.1), True),
        (PidConfig(kp=0.1), False),
        (PidConfig(ki=0.1), False),
        (PidConfig(kv=0.1), False),
    ],
)
def test_a_wheel_whose_gains_bring_no_speed_about_refuses(gains: PidConfig, refused: bool) -> None:
    robot = RobotDouble()
    robot.core = make_core(left=gains)
    robot.ticks(WARM_TICKS)
    ack = answer(robot)
    assert ack.accepted != refused
    if refused:
        (reason,) = ack.reasons
        assert (reason.code, reason.part) == (C.NO_GAINS, "left")
