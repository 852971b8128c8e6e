"""Every input has an age, beyond which it stops the robot or counts for nothing."""

import math
from collections.abc import Callable

import pytest

from robotctl.drivers.can.nodes.motor import DriveStatus
from robotctl.messages.control import Feedback, SafetyState, VelocityCommand
from robotctl.messages.faults import FaultCode as C
from robotctl.safety.ages import is_fresh
from robotctl.safety.health import Health
from robotctl.safety.state_machine import SafetyConfig
from tests.core.robot_double import NODES as NODES_WANTED
from tests.core.robot_double import PERIOD_NS, RobotDouble
from tests.native_frames import WHEELS, age_limits, reports

SAFETY = SafetyConfig()
MS = 1_000_000
Damage = Callable[[RobotDouble], None]


def mute(name: str) -> Damage:
    return lambda robot: setattr(robot, name, True)


def stop_heartbeat(robot: RobotDouble) -> None:
    robot.heartbeat_ns = robot.now_ns


def sonar_fault(robot: RobotDouble) -> None:
    robot.sonar_m = (2.0, 2.0, math.nan, 2.0)


LIMITS = {
    "wheels": (mute("mute_wheels"), SAFETY.feedback_timeout_periods * PERIOD_NS, C.WHEELS_STALE),
    "latch": (mute("frozen_latch"), SAFETY.feedback_timeout_periods * PERIOD_NS, C.WHEELS_STALE),
    "status": (mute("mute_status"), SAFETY.status_timeout_ms * MS, C.MOTOR_STALE),
    "battery": (mute("mute_battery"), SAFETY.battery_timeout_ms * MS, C.BATTERY_STALE),
    "sonars": (mute("mute_sonars"), SAFETY.sonar_timeout_ms * MS, C.SONAR_STALE),
    "one sonar": (sonar_fault, SAFETY.sonar_timeout_ms * MS, C.SONAR_STALE),
    "heartbeat": (stop_heartbeat, SAFETY.heartbeat_timeout_ms * MS, C.NODE_SILENT),
}


@pytest.mark.parametrize("name", LIMITS)
def test_an_input_stops_the_robot_in_the_first_tick_after_its_limit(name: str) -> None:
    damage, limit_ns, code = LIMITS[name]
    robot = RobotDouble().armed()
    robot.ticks(60, (0.4, 0.0))
    damage(robot)
    last_ns = robot.now_ns
    sent_ns = {"sonars": robot.sonar_ns, "one sonar": robot.sonar_ns, "battery": robot.battery_ns}
    last_ns = sent_ns.get(name, last_ns)
    while robot.now_ns + PERIOD_NS <= last_ns + limit_ns:
        robot.tick(robot.velocity(0.4, 0.0))
        assert robot.state == SafetyState.DRIVING
    robot.tick(robot.velocity(0.4, 0.0))
    assert robot.state == SafetyState.FAULT
    assert robot.snapshot().fault == code
    assert not robot.outputs.command.enable


@pytest.mark.parametrize("name", LIMITS)
def test_an_input_that_is_too_old_keeps_the_robot_from_arming(name: str) -> None:
    damage, limit_ns, code = LIMITS[name]
    robot = RobotDouble()
    robot.tick()
    damage(robot)
    robot.ticks(limit_ns // PERIOD_NS + 120)
    robot.arm(7)
    robot.ticks(SAFETY.arm_timeout_ms * MS // PERIOD_NS + 2)
    ack = robot.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (7, False)
    assert code in {reason.code for reason in ack.reasons}


def test_the_drive_says_for_how_long_no_command_has_reached_it() -> None:
    limit_ms = SAFETY.feedback_timeout_periods * PERIOD_NS // MS
    limits = age_limits(NODES_WANTED, SAFETY, PERIOD_NS)
    health = Health(limits, SAFETY.heartbeat_timeout_ms * MS, WHEELS)

    def status(at_ms: int, age_ms: int) -> None:
        frames = reports(None, None, DriveStatus(at_ms * MS, 0.0, 12.0, age_ms))
        health.update(Feedback(actuators=frames))

    assert health.command_loss(10**12) is None
    status(1000, limit_ms)
    assert health.command_loss(1000 * MS) is None
    status(1020, limit_ms + 1)
    said = f"the motor controller had no valid command for {limit_ms + 1} ms"
    assert str(health.command_loss(1020 * MS)) == said
    status(1040, 0)  # the next ones came through
    assert str(health.command_loss(1120 * MS)) == said
    assert health.command_loss(1120 * MS + 1) is None
    status(1140, 255)
    assert str(health.command_loss(1140 * MS)) == said.replace(f"{limit_ms + 1} ms", "255 ms")


def test_lost_commands_alone_stop_nobody_before_the_drive_does() -> None:
    robot = RobotDouble().armed()
    robot.command_age_ms = 80
    robot.ticks(200, (0.4, 0.0))
    assert robot.state == SafetyState.DRIVING


def test_nobody_is_told_an_old_value() -> None:
    robot = RobotDouble().armed()
    robot.mute_status = robot.mute_battery = robot.mute_sonars = True
    robot.ticks(101)
    state = robot.snapshot()
    assert state.sonar_m
    assert all(math.isnan(range_m) for range_m in state.sonar_m)
    assert math.isnan(state.bus_voltage_v)
    assert (state.battery, state.current_a, state.temperature_c) == (None, (), ())


def test_a_velocity_is_told_as_long_as_wheel_feedback_is_fresh() -> None:
    robot = RobotDouble().armed()
    robot.ticks(200, (0.4, 0.2))
    robot.mute_wheels = True
    robot.ticks(SAFETY.feedback_timeout_periods)
    fresh = robot.snapshot()
    assert (fresh.v_m_s, fresh.omega_rad_s) == pytest.approx((0.4, 0.2), abs=0.05)
    assert all(math.isfinite(speed) for speed in fresh.wheel_rad_s)
    robot.tick()
    stale = robot.snapshot()
    assert all(math.isnan(each) for each in (stale.v_m_s, stale.omega_rad_s, *stale.wheel_rad_s))
    assert len(stale.wheel_rad_s) == 2
    assert (stale.x_m, stale.distance_m) == (fresh.x_m, fresh.distance_m)


@pytest.mark.parametrize("limit", [1, 5, 1000])
def test_the_limit_itself_is_fresh_and_one_more_is_not_on_both_sides_of_now(limit: int) -> None:
    now = 10_000
    assert is_fresh(now - limit, now, limit)
    assert is_fresh(now + limit, now, limit)
    assert not is_fresh(now - limit - 1, now, limit)
    assert not is_fresh(now + limit + 1, now, limit)


def wanted(robot: RobotDouble, stamp_ns: int, expires_ns: int) -> float:
    """The first velocity reference after a set-point with these times."""
    robot.now_ns -= PERIOD_NS
    robot.tick(VelocityCommand(stamp_ns, expires_ns, 0.4, 0.0))
    return robot.snapshot().v_ref_m_s


@pytest.mark.parametrize(
    ("age_ns", "left_ns", "drives"),
    [
        (0, 1, True),
        (0, 0, True),
        (0, -1, False),
        (SAFETY.setpoint_timeout_ms * MS, 10**12, True),
        (SAFETY.setpoint_timeout_ms * MS + 1, 10**12, False),
        (-1, 10**12, False),
        (10**15, 10**18, False),
    ],
)
def test_a_set_point_counts_while_it_is_young_and_not_expired(
    age_ns: int, left_ns: int, drives: bool
) -> None:
    robot = RobotDouble().armed()
    robot.ticks(110)  # no set-point is older than the arming
    reference = wanted(robot, robot.now_ns - age_ns, robot.now_ns + left_ns)
    assert (reference > 0.0) == drives
    assert (robot.state == SafetyState.DRIVING) == drives


def test_a_set_point_that_would_never_expire_does() -> None:
    robot = RobotDouble().armed()
    robot.tick(robot.velocity(0.5, 0.0, ttl_ns=10**15))
    for _ in range(400):
        robot.tick()
    assert robot.state == SafetyState.ARMED
    assert robot.speeds == pytest.approx([0.0, 0.0], abs=0.02)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("command_timeout_ms", 10, 1000),
        ("feedback_timeout_periods", 2, 10),
        ("status_timeout_ms", 1, 1000),
        ("battery_timeout_ms", 1, 5000),
        ("sonar_timeout_ms", 1, 1000),
        ("heartbeat_timeout_ms", 1, 5000),
        ("setpoint_timeout_ms", 1, 2000),
        ("arm_timeout_ms", 1, 10_000),
        ("request_max_age_ms", 1, 10_000),
        ("warmup_ticks", 1, 10_000),
    ],
)
def test_no_limit_can_be_set_away(name: str, low: int, high: int) -> None:
    for allowed in (low, high):
        assert getattr(SafetyConfig(**{name: allowed}), name) == allowed
    for refused in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"^{name} must be {low} to {high}, not {refused}$"):
            SafetyConfig(**{name: refused})
