"""What `Health` keeps, for how long, and in which words it refuses; each bound from both sides."""

import dataclasses
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.drives.native.faults import fault_words
from robotctl.drivers.can.nodes.motor import DriveFault, DriveStatus, MotorStatus, WheelFeedback
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import (
    AccelerometerFeedback,
    BatteryFeedback,
    BusState,
    BusStatus,
    Feedback,
    GyroFeedback,
    NodeStatus,
    SonarFeedback,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.ages import fresh_span_ns, is_fresh
from robotctl.safety.health import Health
from robotctl.safety.state_machine import SafetyConfig
from tests.native_frames import WHEELS as ACTUATORS
from tests.native_frames import age_limits, reports

replace = msgspec.structs.replace
MS = 1_000_000
NOW = 10_000 * MS
PERIOD_NS = 5 * MS
# All different, so that no limit can stand for another.
SAFETY = SafetyConfig(
    feedback_timeout_periods=3,
    status_timeout_ms=200,
    battery_timeout_ms=500,
    sonar_timeout_ms=250,
    heartbeat_timeout_ms=350,
)
NODES = (
    NodeStatus(1, "drive", 5, NOW, 1, ""),
    NodeStatus(2, "sonar ring", 5, NOW, 1, ""),
)
WHEELS = WheelFeedback(NOW, 77, (0, 0))
MOTOR = MotorStatus(NOW, DriveState.READY, 0, (0.0, 0.0), (25.0, 25.0))
DRIVE = DriveStatus(NOW, 0.0, 12.0, 1)
FRAMES = {"wheels": WHEELS, "motor": MOTOR, "drive": DRIVE}
GOOD = Feedback(
    actuators=reports(**FRAMES),
    sonars=(SonarFeedback(NOW, 0, (1.0, math.inf, 3.0, 4.0)),),
    battery=BatteryFeedback(NOW, 12.0, 1.0, 0.8, 25.0, False, False),
    nodes=NODES,
)
NAMES = ("front", "left", "rear", "right")


WANTED = NodeParameters(200, 90, 350, sonars=4)


def make(safety: SafetyConfig, period_ns: int, sonars: tuple[str, ...] = NAMES) -> Health:
    ages = age_limits(WANTED, safety, period_ns)
    return Health(ages, safety.heartbeat_timeout_ms * MS, ACTUATORS, sonars)


def health(*feedback: Feedback, sonars: tuple[str, ...] = NAMES) -> Health:
    kept = make(SAFETY, PERIOD_NS, sonars)
    for each in feedback or (GOOD,):
        kept.update(each)
    return kept


def frames(**values: object) -> Feedback:
    """Healthy feedback but for some frames of the drive."""
    return replace(GOOD, actuators=reports(**(FRAMES | values)))


def battery(**values: object) -> Feedback:
    return replace(GOOD, battery=replace(GOOD.battery, **values))


def motor(**values: object) -> Feedback:
    return frames(motor=replace(MOTOR, **values))


def drive(**values: object) -> Feedback:
    return frames(drive=replace(DRIVE, **values))


def bus(**values: object) -> Feedback:
    return replace(GOOD, bus=BusStatus(**values))


def texts(faults: tuple[Fault, ...]) -> tuple[str, ...]:
    return tuple(map(str, faults))


def test_nothing_speaks_against_a_healthy_robot() -> None:
    kept = health()
    assert kept.fault(NOW) is None
    assert kept.node_problem(NOW) is None
    assert kept.refusals(NOW) == ()
    assert not kept.drive_latched


def test_before_the_first_feedback_every_input_that_is_missing_is_named() -> None:
    assert texts(health(Feedback()).refusals(NOW)) == (
        "wheel feedback is older than 15 ms",
        "motor status is older than 200 ms",
        "drive status is older than 200 ms",
        "the battery has not reported yet",
        "sonar front has given no range for 250 ms",
        "sonar left has given no range for 250 ms",
        "sonar rear has given no range for 250 ms",
        "sonar right has given no range for 250 ms",
        "no heartbeat from any node on the bus",
    )


def test_a_refusal_tells_its_limit_as_it_was_configured() -> None:
    second = {f"{name}_timeout_ms": 1000 for name in ("status", "battery", "sonar", "heartbeat")}
    kept = make(SafetyConfig(feedback_timeout_periods=10, **second), 100 * MS)
    kept.update(GOOD)
    assert kept.refusals(NOW + 1000 * MS) == ()
    assert texts(kept.refusals(NOW + 1000 * MS + 1)) == (
        "wheel feedback is older than 1000 ms",
        "motor status is older than 1000 ms",
        "drive status is older than 1000 ms",
        "the battery's report is older than 1000 ms",
        *(f"sonar {name} has given no range for 1000 ms" for name in NAMES),
        *(f"{node.name} (node {node.node_id}): no heartbeat for 1000 ms" for node in NODES),
    )


@pytest.mark.parametrize("now_ns", [0, 1, NOW])
def test_a_health_that_never_saw_anything_has_seen_nothing_at_any_time(now_ns: int) -> None:
    """Nor does the time since the machine's start let it look fresh."""
    kept = make(SAFETY, PERIOD_NS)
    assert str(kept.fault(now_ns)) == "wheel feedback is older than 15 ms"
    assert len(kept.sonars.fresh_m(now_ns)) == len(NAMES)
    assert all(math.isnan(range_m) for range_m in kept.sonars.fresh_m(now_ns))
    assert not kept.reports_fresh(now_ns)
    assert kept.drives[0].supply_v(now_ns) is None
    assert kept.fresh_battery(now_ns) is None
    assert not kept.drive_latched
    assert len(kept.refusals(now_ns)) == 9


AGES = {
    "wheels": (15, "wheel feedback is older than 15 ms"),
    "motor": (200, "motor status is older than 200 ms"),
    "drive": (200, "drive status is older than 200 ms"),
    "battery": (500, "the battery's report is older than 500 ms"),
    "sonars": (250, "sonar front has given no range for 250 ms"),
    "nodes": (350, "drive (node 1): no heartbeat for 350 ms"),
}


def aged(name: str, age_ns: int) -> Feedback:
    """Healthy feedback of which one part is so old."""
    stamp_ns = NOW - age_ns
    if name == "nodes":
        return replace(GOOD, nodes=tuple(replace(node, heartbeat_ns=stamp_ns) for node in NODES))
    if name == "sonars":
        return replace(GOOD, sonars=(replace(GOOD.sonars[0], stamp_ns=stamp_ns),))
    if name in FRAMES:
        return frames(**{name: replace(FRAMES[name], stamp_ns=stamp_ns)})
    return replace(GOOD, **{name: replace(getattr(GOOD, name), stamp_ns=stamp_ns)})


@pytest.mark.parametrize("name", AGES)
@pytest.mark.parametrize("direction", [1, -1])
def test_an_input_is_used_up_to_its_limit_and_not_one_nanosecond_longer(
    name: str, direction: int
) -> None:
    limit_ms, words = AGES[name]
    assert health(aged(name, direction * limit_ms * MS)).refusals(NOW) == ()
    refusals = health(aged(name, direction * (limit_ms * MS + 1))).refusals(NOW)
    assert str(refusals[0]) == words
    assert len(refusals) == {"sonars": 4, "nodes": 2}.get(name, 1)


def test_what_is_too_old_is_given_to_nobody() -> None:
    old = health(aged("motor", 200 * MS))
    assert old.reports_fresh(NOW)
    assert not old.reports_fresh(NOW + 1)
    old = health(aged("drive", 200 * MS))
    assert old.drives[0].supply_v(NOW) == 12.0
    assert old.drives[0].supply_v(NOW + 1) is None
    feedback = aged("battery", 500 * MS)
    assert health(feedback).fresh_battery(NOW) == feedback.battery
    assert health(feedback).fresh_battery(NOW + 1) is None
    kept = health()
    assert kept.sonars.fresh_m(NOW + 250 * MS) == (1.0, math.inf, 3.0, 4.0)
    assert all(math.isnan(range_m) for range_m in kept.sonars.fresh_m(NOW + 250 * MS + 1))


def test_feedback_without_news_keeps_what_was_there() -> None:
    kept = health(GOOD, Feedback(nodes=NODES))
    assert (kept.reports, kept.battery) == (GOOD.actuators, GOOD.battery)
    assert kept.refusals(NOW) == ()


def test_nodes_and_bus_are_the_present_state() -> None:
    kept = health(GOOD, bus(state=BusState.BUS_OFF))
    assert kept.bus.state == BusState.BUS_OFF
    kept.update(Feedback())
    assert kept.bus == BusStatus()
    assert str(kept.node_problem(NOW)) == "no heartbeat from any node on the bus"


def test_wheel_feedback_with_the_latch_of_before_is_none() -> None:
    later = NOW + 15 * MS + 1
    kept = health(GOOD, frames(wheels=replace(WHEELS, stamp_ns=later)))
    assert str(kept.fault(later)) == "wheel feedback is older than 15 ms"
    kept.update(frames(wheels=replace(WHEELS, stamp_ns=later, timestamp_us=78)))
    assert kept.fault(later) is None


@pytest.mark.parametrize("latch_us", [0, 1])
def test_the_first_latch_counts_whatever_it_is(latch_us: int) -> None:
    first = frames(wheels=replace(WHEELS, timestamp_us=latch_us))
    assert health(first).fault(NOW) is None


def test_a_group_of_sonars_goes_where_its_first_says_and_none_beyond_the_ring() -> None:
    second = SonarFeedback(NOW, 4, (5.0, 6.0, 7.0, 8.0))
    names = (*NAMES, "fifth", "sixth")
    kept = health(replace(GOOD, sonars=(*GOOD.sonars, second)), sonars=names)
    assert kept.sonars.fresh_m(NOW) == (1.0, math.inf, 3.0, 4.0, 5.0, 6.0)
    assert kept.fault(NOW) is None


def test_a_sonar_that_reports_its_own_fault_keeps_the_time_of_its_last_range() -> None:
    later = NOW + 100 * MS
    broken = SonarFeedback(later, 0, (1.5, math.nan, 2.5, 3.5))
    kept = health(GOOD, replace(GOOD, sonars=(broken,)))
    assert kept.sonars.stamps_ns == [later, NOW, later, later]
    assert math.isnan(kept.sonars.fresh_m(later)[1])
    # Nothing else has grown old by then but what else was sent at NOW.
    reasons = kept.refusals(NOW + 250 * MS + 1)
    silent = [reason.part for reason in reasons if reason.code == FaultCode.SONAR_STALE]
    assert silent == ["left"]


@pytest.mark.parametrize(
    ("feedback", "reason"),
    [
        (bus(state=BusState.BUS_OFF), "the CAN bus is bus off"),
        (bus(state=BusState.DOWN), "the CAN bus is down"),
        (motor(state=DriveState.STOPPED), "the motor controller is in stopped"),
        (motor(state=DriveState.EMERGENCY_STOP), "the motor controller is in emergency stop"),
        (
            motor(state=DriveState.FAULT, faults=DriveFault.ENCODER | DriveFault.OVER_CURRENT),
            "the motor controller is in fault: over current, encoder",
        ),
        (battery(critical=True, voltage_v=9.44), "the battery is critical (9.4 V)"),
        (battery(critical=True, low=True), "the battery is critical (12.0 V)"),
        (
            replace(GOOD, nodes=(NODES[0], replace(NODES[1], problem="node 2 is wrong"))),
            "node 2 is wrong",
        ),
    ],
)
def test_each_reason_to_stop_also_keeps_from_arming_and_stands_once(
    feedback: Feedback, reason: str
) -> None:
    kept = health(feedback)
    assert str(kept.fault(NOW)) == reason
    assert texts(kept.refusals(NOW)) == (reason,)


@pytest.mark.parametrize(
    ("feedback", "code", "reason"),
    [
        (
            battery(low=True, voltage_v=10.06),
            FaultCode.BATTERY_LOW,
            "the battery is low (10.1 V)",
        ),
        (bus(state=BusState.ERROR_PASSIVE), FaultCode.BUS_PASSIVE, "the CAN bus is error passive"),
        (bus(load=0.9), FaultCode.BUS_FULL, "the CAN bus is 90% full, 80% allowed"),
        (
            bus(load=math.nextafter(0.8, 1.0)),
            FaultCode.BUS_FULL,
            "the CAN bus is 80% full, 80% allowed",
        ),
        (
            drive(command_age_ms=16),
            FaultCode.COMMAND_LOSS,
            "the motor controller had no valid command for 16 ms",
        ),
        (
            drive(command_age_ms=255, stamp_ns=NOW - 200 * MS),
            FaultCode.COMMAND_LOSS,
            "the motor controller had no valid command for 255 ms",
        ),
    ],
)
def test_what_only_keeps_from_arming_stops_nobody(
    feedback: Feedback, code: FaultCode, reason: str
) -> None:
    kept = health(feedback)
    assert kept.fault(NOW) is None
    (refusal,) = kept.refusals(NOW)
    assert (refusal.code, refusal.text) == (code, reason)


@pytest.mark.parametrize(
    "feedback",
    [
        bus(load=0.8),
        bus(state=BusState.ERROR_WARNING),
        drive(command_age_ms=15),
        motor(state=DriveState.ENABLED),
        motor(state=DriveState.BOOT),
    ],
)
def test_what_is_allowed_is_no_reason(feedback: Feedback) -> None:
    assert health(feedback).refusals(NOW) == ()


def test_a_drive_that_reports_a_fault_is_not_trusted_though_it_has_not_stopped() -> None:
    kept = health(motor(state=DriveState.READY, faults=int(DriveFault.PARAMETER)))
    assert texts(kept.refusals(NOW)) == ("the motor controller reports: parameter",)
    assert str(kept.fault(NOW)) == "the motor controller reports: parameter"


def test_what_the_drive_heard_last_counts_for_arming() -> None:
    assert health(drive(command_age_ms=255), GOOD).refusals(NOW) == ()
    old = drive(command_age_ms=255, stamp_ns=NOW - 200 * MS - 1)
    assert texts(health(old).refusals(NOW)) == ("drive status is older than 200 ms",)


def at(after_ns: int, state: DriveState, age_ms: int = 1) -> Feedback:
    """Healthy feedback of so long after NOW."""
    stamp_ns = NOW + after_ns
    return frames(
        wheels=WheelFeedback(stamp_ns, 77 + after_ns // 1000, (0, 0)),
        motor=replace(MOTOR, state=state, stamp_ns=stamp_ns),
        drive=replace(DRIVE, command_age_ms=age_ms, stamp_ns=stamp_ns),
    )


@pytest.mark.parametrize("state", [DriveState.READY, DriveState.BOOT])
@pytest.mark.parametrize("enabled_ns", [0, 50 * MS])
def test_a_drive_that_is_not_enabled_100_ms_behind_arming_or_being_so_is_a_fault(
    state: DriveState, enabled_ns: int
) -> None:
    kept = health()
    kept.armed(NOW)
    if enabled_ns:
        kept.update(at(enabled_ns, DriveState.ENABLED))
    late_ns = enabled_ns + 100 * MS
    kept.update(at(late_ns, state))
    assert kept.fault(NOW + late_ns) is None
    kept.update(at(late_ns + 1, state))
    words = f"the motor controller stays in {state.name.lower()} although commanded to drive"
    assert str(kept.fault(NOW + late_ns + 1)) == words
    kept.update(at(late_ns + 2, state, age_ms=16))
    unheard = "the motor controller had no valid command for 16 ms"
    assert str(kept.fault(NOW + late_ns + 2)) == unheard
    kept.update(at(late_ns + 3, DriveState.STOPPED))
    assert str(kept.fault(NOW + late_ns + 3)) == "the motor controller is in stopped"
    kept.update(at(late_ns + 4, DriveState.ENABLED))
    assert kept.fault(NOW + late_ns + 4) is None


def test_each_node_that_is_out_of_service_is_named() -> None:
    silent = replace(NODES[0], heartbeat_ns=NOW - 350 * MS - 1)
    wrong = replace(NODES[1], problem="sonar ring (node 2): wrong firmware", heartbeat_ns=0)
    kept = health(replace(GOOD, nodes=(silent, wrong)))
    assert str(kept.node_problem(NOW)) == "drive (node 1): no heartbeat for 350 ms"
    assert texts(kept.refusals(NOW)) == (
        "drive (node 1): no heartbeat for 350 ms",
        "sonar ring (node 2): wrong firmware",
    )


@pytest.mark.parametrize("state", DriveState)
def test_the_drive_is_latched_in_its_three_stopped_states_however_old(state: DriveState) -> None:
    latched = state in {DriveState.STOPPED, DriveState.FAULT, DriveState.EMERGENCY_STOP}
    assert health(motor(state=state, stamp_ns=0)).drive_latched == latched


def paused(pause_ms: int, later: Feedback | None = None, later_ms: int = 0) -> str:
    """Return the reason to stop behind a pause, after which `later` comes."""
    made = health(GOOD)
    made.armed(NOW)
    made.stalls.step(NOW)
    now_ns = NOW + pause_ms * MS
    made.stalls.step(now_ns)
    for _ in range(later_ms // 5):
        now_ns += 5 * MS
        made.stalls.step(now_ns)
    if later is not None:
        made.update(later)
    return str(made.fault(now_ns) or "")


CODES = [
    (bus(state=BusState.BUS_OFF), FaultCode.BUS_OFF, ""),
    (bus(state=BusState.DOWN), FaultCode.BUS_DOWN, ""),
    (aged("wheels", 16 * MS), FaultCode.WHEELS_STALE, "drive"),
    (aged("motor", 201 * MS), FaultCode.MOTOR_STALE, "drive"),
    (aged("drive", 201 * MS), FaultCode.DRIVE_STALE, "drive"),
    (aged("battery", 501 * MS), FaultCode.BATTERY_STALE, ""),
    (replace(GOOD, battery=None), FaultCode.BATTERY_MISSING, ""),
    (battery(critical=True), FaultCode.BATTERY_CRITICAL, ""),
    (aged("sonars", 251 * MS), FaultCode.SONAR_STALE, "front"),
    (aged("nodes", 351 * MS), FaultCode.NODE_SILENT, "drive"),
    (replace(GOOD, nodes=()), FaultCode.NODE_NOT_HEARD, ""),
    (
        replace(
            GOOD,
            nodes=(NODES[0], replace(NODES[1], problem="no", fault=FaultCode.NODE_CHANGED)),
        ),
        FaultCode.NODE_CHANGED,
        "sonar ring",
    ),
    (motor(state=DriveState.STOPPED, faults=16), FaultCode.DRIVE_STOPPED, "drive"),
    (motor(state=DriveState.EMERGENCY_STOP, faults=1), FaultCode.DRIVE_EMERGENCY_STOP, "drive"),
    (motor(state=DriveState.FAULT), FaultCode.DRIVE_FAULT, "drive"),
    (motor(state=DriveState.FAULT, faults=8 | 1), FaultCode.DRIVE_OVER_CURRENT, "drive"),
    *(
        (motor(state=state, faults=int(bit)), FaultCode[f"DRIVE_{bit.name}"], "drive")
        for bit in DriveFault
        for state in (DriveState.FAULT, DriveState.ENABLED)
    ),
]


@pytest.mark.parametrize(("feedback", "code", "part"), CODES)
def test_each_fault_has_its_code_and_the_part_it_is_about(
    feedback: Feedback, code: FaultCode, part: str
) -> None:
    fault = health(feedback).fault(NOW)
    assert fault is not None
    assert (fault.code, fault.part) == (code, part)


@pytest.mark.parametrize(("pause_ms", "code"), [(15, None), (16, FaultCode.CONTROL_HELD_UP)])
def test_a_pause_has_a_code_of_its_own(pause_ms: int, code: FaultCode | None) -> None:
    made = health(GOOD)
    made.armed(NOW)
    made.stalls.step(NOW)
    made.stalls.step(NOW + pause_ms * MS)
    fault = made.fault(NOW + pause_ms * MS)
    assert (fault and fault.code) == code


def test_what_is_too_old_behind_a_pause_of_this_process_is_blamed_on_the_pause() -> None:
    assert paused(512) == "control was held up for 512 ms: wheel feedback is older than 15 ms"


def test_what_is_too_old_without_a_pause_is_not() -> None:
    made = health(GOOD)
    for tick in range(20):
        made.stalls.step(NOW + tick * 5 * MS)
    assert str(made.fault(NOW + 95 * MS)) == "wheel feedback is older than 15 ms"


@pytest.mark.parametrize(
    ("state", "faults", "words"),
    [
        (
            DriveState.STOPPED,
            DriveFault.COMMAND_TIMEOUT,
            "control was held up for 100 ms: the motor controller is in stopped: command timeout",
        ),
        (
            DriveState.FAULT,
            DriveFault.OVER_CURRENT,
            "the motor controller is in fault: over current",
        ),
    ],
)
def test_the_motor_controllers_own_stop_is_explained_by_a_pause_and_its_faults_are_not(
    state: DriveState, faults: DriveFault, words: str
) -> None:
    at = NOW + 120 * MS
    later = frames(
        motor=replace(MOTOR, state=state, faults=int(faults), stamp_ns=at),
        wheels=WheelFeedback(at, 78, (0, 0)),
        drive=replace(DRIVE, stamp_ns=at),
    )
    assert paused(100, later, 20) == words


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        (0, ""),
        (DriveFault.COMMAND_TIMEOUT, ": command timeout"),
        (
            63,
            ": over current, over temperature, under voltage, encoder, command timeout, parameter",
        ),
        (64, ""),
    ],
)
def test_fault_bits_are_told_in_words(faults: int, words: str) -> None:
    assert fault_words(faults) == words


@given(
    stamps_ns=st.lists(st.integers(0, 12), max_size=4),
    now_ns=st.integers(0, 12),
    limit_ns=st.integers(0, 6),
)
def test_stamps_are_fresh_together_if_each_of_them_is(
    stamps_ns: list[int], now_ns: int, limit_ns: int
) -> None:
    each = all(is_fresh(stamp_ns, now_ns, limit_ns) for stamp_ns in stamps_ns)
    first_ns, last_ns = fresh_span_ns(stamps_ns, limit_ns)
    assert (first_ns <= now_ns <= last_ns) == each


# What is judged by its age alone: gyro and accelerometer.
INERTIAL = msgspec.structs.replace(
    GOOD,
    gyro=GyroFeedback(NOW, 0.0, 0.0, 0.1),
    accelerometer=AccelerometerFeedback(NOW, 0.0, 0.0, 9.8),
)
IMU_SAFETY = dataclasses.replace(SAFETY, imu_timeout_ms=70)
WITH_IMU = dataclasses.replace(WANTED, imu=True)


def inertial(*feedback: Feedback) -> Health:
    kept = Health(age_limits(WITH_IMU, IMU_SAFETY, PERIOD_NS), 350 * MS, ACTUATORS, NAMES)
    for each in feedback:
        kept.update(each)
    return kept


def test_a_robot_with_an_imu_is_healthy_while_both_sensors_report() -> None:
    kept = inertial(INERTIAL)
    assert kept.refusals(NOW) == ()
    assert kept.is_fresh("gyro", NOW)
    assert kept.is_fresh("accelerometer", NOW + 70 * MS)
    assert not kept.is_fresh("gyro", NOW + 70 * MS + 1)
    assert not kept.is_fresh("no such field", NOW)


@pytest.mark.parametrize("silent", ["gyro", "accelerometer"])
def test_each_sensor_of_the_imu_has_an_age_of_its_own(silent: str) -> None:
    kept = inertial(INERTIAL)
    for later_ns in (20 * MS, 40 * MS, 60 * MS, 71 * MS):
        at_ns = NOW + later_ns
        newer = {
            name: replace(getattr(INERTIAL, name), stamp_ns=at_ns)
            for name in ("gyro", "accelerometer")
            if name != silent
        }
        wheels = replace(WHEELS, stamp_ns=at_ns, timestamp_us=77 + later_ns // 1000)
        kept.update(replace(frames(wheels=wheels), **newer))
        expected = f"the {silent}'s report is older than 70 ms"
        said = (Fault(FaultCode.IMU_STALE, expected, "imu"),) if later_ns > 70 * MS else ()
        assert kept.refusals(at_ns) == said
        assert kept.fault(at_ns) == (said[0] if said else None)


def test_an_imu_that_never_reported_is_said_twice() -> None:
    assert [fault.code for fault in inertial(GOOD).refusals(NOW)] == [FaultCode.IMU_STALE] * 2
    assert not inertial().is_fresh("gyro", NOW)


def test_a_pause_of_control_explains_an_imu_that_is_not_heard() -> None:
    kept = inertial(INERTIAL)
    kept.stalls.step(NOW)
    kept.stalls.step(NOW + 100 * MS)
    kept.update(frames(wheels=replace(WHEELS, stamp_ns=NOW + 100 * MS, timestamp_us=99)))
    fault = kept.fault(NOW + 100 * MS)
    assert fault is not None
    assert fault.code is FaultCode.CONTROL_HELD_UP
    assert str(fault).endswith("ms: the gyro's report is older than 70 ms")


def test_commands_that_are_lost_are_a_fault_of_the_drive() -> None:
    lost = Fault(
        FaultCode.COMMAND_LOSS, "the motor controller had no valid command for 60 ms", "drive"
    )
    kept = health(drive(command_age_ms=60))
    assert kept.command_loss(NOW) == lost
    assert lost in kept.refusals(NOW)


def test_a_drive_that_is_not_enabled_is_a_fault_of_the_drive() -> None:
    kept = health()
    kept.armed(NOW - 101 * MS)
    fault = kept.fault(NOW)
    assert fault is not None
    assert (fault.code, fault.part) == (FaultCode.DRIVE_NOT_ENABLED, "drive")
