"""A motor test: one wheel, a little, for a while, and whatever ends it ends it at once."""

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.core.motor_test import CLEAR_M, FASTEST_M_S, LONGEST_NS
from robotctl.messages.control import (
    Arm,
    DriveState,
    EmergencyStop,
    EmergencyStopSource,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.procedures import CancelProcedure, MotorTest, Outcome
from tests.core.robot_double import BUS_V, K_V_S_RAD, PERIOD_NS, WARM_TICKS, RobotDouble

SECOND_NS = 1_000_000_000
LIFE_NS = 200_000_000
FASTEST_RAD_S = FASTEST_M_S / 0.05
SMALL = 0.08
"""Of the supply: 2.1 rad/s, below the bound."""


class OnTest(RobotDouble):
    """A robot whose requester goes on asking."""

    def __init__(self, wheel=0, effort=SMALL, duration_ns=2 * SECOND_NS, request_id=7):
        super().__init__()
        self.wanted = (request_id, wheel, effort, duration_ns)
        self.ticks(WARM_TICKS)

    def request(self):
        number, wheel, effort, duration_ns = self.wanted
        return MotorTest(self.now_ns, self.now_ns + LIFE_NS, number, wheel, effort, duration_ns)

    def ask(self, ticks=1, *others):
        for _ in range(ticks):
            self.tick(self.request(), *others)

    @property
    def procedure(self):
        return self.snapshot().procedure

    def stands(self):
        """Assert that the motors are off from this tick on."""
        assert self.outputs.command.enable is False
        assert (self.outputs.command.duty1, self.outputs.command.duty2) == (0.0, 0.0)
        assert self.state is not SafetyState.MOTOR_TEST


@pytest.mark.parametrize("wheel", [0, 1])
@pytest.mark.parametrize("effort", [SMALL, -SMALL])
def test_that_wheel_alone_turns_the_way_it_is_told_to_for_as_long_as_it_is_told_to(wheel, effort):
    robot = OnTest(wheel, effort)
    robot.ask(200)
    assert robot.state is SafetyState.MOTOR_TEST
    assert robot.speeds[wheel] == pytest.approx(effort * BUS_V / K_V_S_RAD, rel=0.01)
    assert robot.speeds[1 - wheel] == 0.0
    assert robot.procedure.outcome is Outcome.RUNNING
    assert robot.procedure.progress == pytest.approx(0.5, abs=0.02)
    robot.ask(198)
    assert robot.state is SafetyState.MOTOR_TEST
    robot.ask(4)
    robot.stands()
    assert robot.state is SafetyState.STANDBY
    assert robot.procedure.outcome is Outcome.DONE
    name = ("left", "right")[wheel]
    assert robot.procedure.text.startswith(f"{name} wheel: up to {math.copysign(2.1, effort):+.1f}")


@settings(max_examples=25, deadline=None)
@given(st.floats(-1.0, 1.0), st.integers(0, 1))
def test_no_wheel_is_faster_than_the_bound_nor_turns_the_other_way(effort, wheel):
    robot = OnTest(wheel, effort, SECOND_NS)
    robot.ask(150)
    assert robot.procedure.outcome is Outcome.RUNNING
    assert abs(robot.speeds[wheel]) <= FASTEST_RAD_S * 1.001
    assert robot.speeds[wheel] * effort >= 0.0
    expected = math.copysign(min(abs(effort) * BUS_V / K_V_S_RAD, FASTEST_RAD_S), effort)
    # The absolute tolerance is one step of the duty on the wire, 1e-4 of the supply.
    assert robot.speeds[wheel] == pytest.approx(expected, rel=0.02, abs=1e-4 * BUS_V / K_V_S_RAD)


def test_it_ends_at_once_when_the_requester_falls_silent():
    robot = OnTest()
    robot.ask(100)
    asked_ns = robot.now_ns - PERIOD_NS
    while robot.state is SafetyState.MOTOR_TEST:
        robot.tick()
    assert robot.now_ns - asked_ns <= LIFE_NS + PERIOD_NS
    robot.stands()
    assert robot.procedure.outcome is Outcome.FAILED
    assert "silent" in robot.procedure.text
    robot.ask(10)
    assert robot.state is SafetyState.STANDBY, "an ended test does not begin again"


def test_no_request_counts_for_long_whatever_it_says():
    robot = OnTest()
    robot.tick(msgspec.structs.replace(robot.request(), expires_ns=robot.now_ns + 60 * SECOND_NS))
    for _ in range(99):
        robot.tick()
    assert robot.state is SafetyState.MOTOR_TEST
    robot.ticks(3)
    robot.stands()


@pytest.mark.parametrize(
    ("end", "outcome", "state"),
    [
        (lambda r: CancelProcedure(r.now_ns, 7), Outcome.CANCELLED, SafetyState.STANDBY),
        (lambda r: Arm(r.now_ns, 3, arm=False), Outcome.CANCELLED, SafetyState.STANDBY),
        (
            lambda r: EmergencyStop(r.now_ns, EmergencyStopSource.TEST),
            Outcome.FAILED,
            SafetyState.EMERGENCY_STOP,
        ),
    ],
)
def test_it_ends_in_the_tick_that_brings_a_cancellation_a_disarming_or_a_stop(end, outcome, state):
    robot = OnTest()
    robot.ask(100)
    robot.tick(robot.request(), end(robot))
    robot.stands()
    assert robot.state is state
    assert robot.procedure.outcome is outcome
    robot.ask(5)
    assert robot.state is state


def test_it_ends_when_arming_is_asked_for_and_the_robot_arms_at_rest():
    robot = OnTest()
    robot.ask(100)
    robot.tick(robot.request(), Arm(robot.now_ns, 3, arm=True))
    assert robot.procedure.outcome is Outcome.CANCELLED
    assert robot.procedure.text == "arming was asked for"
    robot.ask(40)
    assert robot.state in {SafetyState.ARMED, SafetyState.DRIVING}
    assert robot.snapshot().acks[-1].accepted
    robot.ticks(100)
    assert robot.speeds[0] == pytest.approx(0.0, abs=0.05)


def test_nobodys_velocity_is_followed_meanwhile_nor_afterwards():
    robot = OnTest(duration_ns=SECOND_NS)
    for _ in range(150):
        robot.tick(robot.request(), robot.velocity(0.5, 1.0))
    assert robot.speeds[1] == 0.0
    for _ in range(100):
        robot.tick(robot.request(), robot.velocity(0.5, 1.0))
    robot.stands()
    assert robot.state is SafetyState.STANDBY


def silence(robot):
    robot.mute_wheels = True


def break_drive(robot):
    robot.drive_says = DriveState.FAULT


@pytest.mark.parametrize("fault", [silence, break_drive])
def test_it_is_supervised_as_an_armed_robot_is(fault):
    robot = OnTest()
    robot.ask(100)
    fault(robot)
    robot.ask(10)
    robot.stands()
    assert robot.state is SafetyState.FAULT
    assert robot.procedure.outcome is Outcome.FAILED
    assert robot.procedure.text == robot.core.machine.reason


class WithReversedEncoder(OnTest):
    """The left encoder counts backwards."""

    def _move(self):
        self.angles[0] *= -1.0
        super()._move()
        self.angles[0] *= -1.0


def test_a_reversed_encoder_is_found_and_makes_no_wheel_faster():
    robot = WithReversedEncoder(effort=1.0)
    fastest_rad_s = 0.0
    for _ in range(200):
        robot.ask()
        fastest_rad_s = max(fastest_rad_s, abs(robot.speeds[0]))
    assert robot.state is SafetyState.FAULT
    assert robot.core.machine.fault.code is FaultCode.ENCODER_REVERSED
    assert fastest_rad_s <= FASTEST_RAD_S


def test_an_obstacle_keeps_it_from_beginning_and_ends_it():
    robot = OnTest()
    free = robot.sonar_m
    robot.sonar_m = (2.0, math.inf, CLEAR_M - 0.01, 2.0)
    robot.ticks(60)
    robot.ask()
    robot.stands()
    assert robot.procedure.outcome is Outcome.REFUSED
    assert "0.14 m" in robot.procedure.text
    robot.sonar_m = free
    robot.ticks(20)
    robot.wanted = (8, *robot.wanted[1:])
    robot.ask(50)
    assert robot.state is SafetyState.MOTOR_TEST
    robot.sonar_m = (2.0, CLEAR_M - 0.01, 2.0, 2.0)
    robot.ask(20)
    robot.sonar_m = free
    robot.ask(50)
    assert robot.state is SafetyState.MOTOR_TEST, "one echo may be another sonar's"
    robot.sonar_m = (2.0, CLEAR_M - 0.01, 2.0, 2.0)
    robot.ask(55)
    robot.stands()
    assert robot.procedure.outcome is Outcome.FAILED


def test_a_wheel_that_something_else_turns_ends_it():
    robot = OnTest(effort=0.0)
    robot.ask(50)
    robot.angles[0] += 0.2
    for _ in range(30):
        robot.angles[0] += 12.0 * PERIOD_NS * 1e-9
        robot.ask()
    robot.stands()
    assert robot.procedure.outcome in {Outcome.FAILED}


@pytest.mark.parametrize(
    ("wheel", "effort", "duration_ns", "word"),
    [
        (2, SMALL, SECOND_NS, "0 to 1"),
        (-1, SMALL, SECOND_NS, "0 to 1"),
        (0, 1.01, SECOND_NS, "-1 to 1"),
        (0, math.nan, SECOND_NS, "-1 to 1"),
        (0, SMALL, 0, "up to 5 s"),
        (0, SMALL, LONGEST_NS + 1, "up to 5 s"),
    ],
)
def test_what_is_out_of_bounds_turns_nothing(wheel, effort, duration_ns, word):
    robot = OnTest(wheel, effort, duration_ns)
    robot.ask(10)
    robot.stands()
    assert robot.procedure.outcome is Outcome.REFUSED
    assert word in robot.procedure.text


def test_an_old_request_turns_nothing():
    robot = OnTest()
    request = robot.request()
    robot.ticks(120)
    robot.tick(request)
    robot.stands()
    assert robot.procedure.outcome is Outcome.REFUSED


def test_it_needs_a_disarmed_robot_without_anything_against_arming():
    robot = RobotDouble().armed()
    request = MotorTest(robot.now_ns, robot.now_ns + LIFE_NS, 7, 0, SMALL, SECOND_NS)
    robot.tick(request)
    assert robot.state is SafetyState.ARMED
    assert robot.snapshot().procedure.outcome is Outcome.REFUSED
    robot = OnTest()
    robot.objections = (Fault(FaultCode.RIGHT_MISSING, "no right"),)
    robot.ask()
    robot.stands()
    assert robot.procedure.text == "no right"
    robot = OnTest()
    robot.tick(EmergencyStop(robot.now_ns, EmergencyStopSource.TEST))
    robot.ask()
    robot.stands()
    assert "EMERGENCY_STOP" in robot.procedure.text
