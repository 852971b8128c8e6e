"""PREFLIGHT_CALIBRATION and DO_MOTOR_TEST: requests to control, progress, results, cancelling."""

import math

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.core.motor_test import LONGEST_NS
from robotctl.dialect import additions
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import SafetyState
from robotctl.messages.procedures import (
    CalibrateGyro,
    CancelProcedure,
    MotorTest,
    Outcome,
    Procedure,
)
from tests.mavlink.conftest import SONAR, SONARS, Bench

CALIBRATE, TEST = m.MAV_CMD_PREFLIGHT_CALIBRATION, m.MAV_CMD_DO_MOTOR_TEST
ACCEPTED, DENIED, LATER = (
    m.MAV_RESULT_ACCEPTED,
    m.MAV_RESULT_DENIED,
    m.MAV_RESULT_TEMPORARILY_REJECTED,
)
FAILED, UNSUPPORTED, IN_PROGRESS = (
    m.MAV_RESULT_FAILED,
    m.MAV_RESULT_UNSUPPORTED,
    m.MAV_RESULT_IN_PROGRESS,
)
CANCELLED = additions.MAV_RESULT_CANCELLED
SECOND_NS = 1_000_000_000
LEFT_10_PERCENT = (1.0, 0.0, 10.0, 2.0, 1.0)
BOTH = pytest.mark.parametrize("command", [(CALIBRATE, 1.0), (TEST, *LEFT_10_PERCENT)])


@pytest.fixture
def bench(bench):
    """Return a bench of a robot with an IMU."""
    robot = TelemetryRobot("tester", "1.2.3", SONARS, SONAR, has_imu=True)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.step(bench.control())
    bench.take()
    return bench


def acks(bench):
    """Return results and progress of the acknowledgements since the last call."""
    return [(ack.result, ack.progress) for ack in bench.messages("COMMAND_ACK")]


def told(bench):
    """Return results and texts since the last call."""
    sent = [each for each, _ in bench.take()]
    return (
        [each.result for each in sent if each.get_type() == "COMMAND_ACK"],
        [each.text for each in sent if each.get_type() == "STATUSTEXT"],
    )


def cancel(bench, number, **source):
    bench.receive(additions.MAVLink_command_cancel_message(1, 1, number), **source)


def at(bench, request, outcome, progress=0.0, text="", **control):
    """Step once with control at some point of a procedure; return the requests."""
    procedure = Procedure(request.request_id, outcome, progress, text)
    return bench.step(bench.control(procedure=procedure, **control))


def begun(bench, number, *params):
    """Return the request that a command led to."""
    bench.command(number, *params)
    (request,) = bench.step(bench.control())
    assert acks(bench) == []
    return request


def test_a_calibration_tells_its_progress_and_its_result(bench):
    request = begun(bench, CALIBRATE, 1.0)
    assert request == CalibrateGyro(bench.now_ns, request.request_id)
    for progress in (0.0, 0.04, 0.1, 0.33, 0.38, 0.99):
        assert at(bench, request, Outcome.RUNNING, progress) == []
    assert acks(bench) == [(IN_PROGRESS, each) for each in (0, 10, 33, 99)]
    at(bench, request, Outcome.DONE, 1.0, "bias of the gyro: +0.01")
    assert told(bench) == ([ACCEPTED], ["Calibration: bias of the gyro: +0.01"])
    at(bench, request, Outcome.DONE, 1.0)
    assert acks(bench) == []


@pytest.mark.parametrize(
    ("outcome", "last"),
    [
        (Outcome.DONE, "[cal] calibration done: gyro"),
        (Outcome.FAILED, "[cal] calibration failed: why"),
        (Outcome.CANCELLED, "[cal] calibration cancelled"),
    ],
)
def test_a_station_of_px4_is_told_in_the_words_that_it_waits_for(outcome, last):
    bench = Bench(personality="px4")
    robot = TelemetryRobot("tester", "1.2.3", SONARS, SONAR, has_imu=True)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.step(bench.control())
    bench.take()
    request = begun(bench, CALIBRATE, 1.0)
    for progress in (0.0, 0.5):
        at(bench, request, Outcome.RUNNING, progress)
    at(bench, request, outcome, text="why")
    texts = [text for text in bench.texts() if text.startswith("[cal]")]
    assert texts == ["[cal] calibration started: 2 gyro", "[cal] progress <50>", last]


@pytest.mark.parametrize(
    ("outcome", "result"),
    [(Outcome.FAILED, FAILED), (Outcome.REFUSED, LATER), (Outcome.CANCELLED, CANCELLED)],
)
@BOTH
def test_what_comes_to_nothing_says_why(bench, command, outcome, result):
    request = begun(bench, *command)
    at(bench, request, outcome, text="the reason")
    results, (text,) = told(bench)
    assert results == [result]
    assert text.endswith(": the reason")


@pytest.mark.parametrize("nan", [0.0, math.nan])
def test_each_other_kind_of_calibration_is_unsupported_with_a_reason(bench, nan):
    for index in range(1, 7):
        params = [nan] * 7
        params[index] = 1.0
        bench.command(CALIBRATE, *params)
        assert bench.step(bench.control()) == []
        results, texts = told(bench)
        assert results == [UNSUPPORTED]
        assert texts, index


@pytest.mark.parametrize(
    ("params", "result"),
    [((1.0, 1.0), DENIED), ((3.0,), UNSUPPORTED), ((math.nan,), DENIED), ((0.0,), ACCEPTED)],
)
def test_calibrations_of_more_or_nothing(bench, params, result):
    bench.command(CALIBRATE, *params)
    assert bench.step(bench.control()) == []
    assert acks(bench) == [(result, 0)]


def test_a_robot_without_a_gyro_says_so(bench):
    robot = TelemetryRobot("tester", "1.2.3", SONARS, SONAR)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.command(CALIBRATE, 1.0)
    assert bench.step(bench.control()) == []
    assert acks(bench) == [(UNSUPPORTED, 0)]


@BOTH
@pytest.mark.parametrize(
    "state",
    [{"state": SafetyState.ARMED}, {"state": SafetyState.DRIVING}, {"v_m_s": 0.1}],
)
def test_an_armed_or_moving_robot_refuses_for_the_time(bench, command, state):
    bench.command(*command)
    assert bench.step(bench.control(**state)) == []
    assert acks(bench) == [(LATER, 0)]


@pytest.mark.parametrize(
    ("params", "wheel", "effort"),
    [
        ((1.0, 0.0, 10.0, 2.0), 0, 0.1),
        ((2.0, 0.0, -25.0, 2.0, math.nan, math.nan), 1, -0.25),
        ((1.0, 1.0, 1750.0, 2.0, 0.0, 2.0), 0, 0.5),
        ((2.0, 1.0, 1000.0, 2.0, 1.0), 1, -1.0),
    ],
)
def test_percent_and_microseconds_turn_that_wheel_that_way(bench, params, wheel, effort):
    request = begun(bench, TEST, *params)
    assert isinstance(request, MotorTest)
    assert (request.wheel, request.duration_ns) == (wheel, 2 * SECOND_NS)
    assert request.effort == pytest.approx(effort)
    assert 0 < request.expires_ns - bench.now_ns <= SECOND_NS // 4


@pytest.mark.parametrize(
    ("params", "result"),
    [
        ((0.0, 0.0, 10.0, 2.0), DENIED),
        ((3.0, 0.0, 10.0, 2.0), DENIED),
        ((1.5, 0.0, 10.0, 2.0), DENIED),
        ((math.nan, 0.0, 10.0, 2.0), DENIED),
        ((1.0, 0.0, 100.5, 2.0), DENIED),
        ((1.0, 0.0, math.nan, 2.0), DENIED),
        ((1.0, 0.0, math.inf, 2.0), DENIED),
        ((1.0, 1.0, 10.0, 2.0), DENIED),
        ((1.0, 1.0, 2001.0, 2.0), DENIED),
        ((1.0, 4.0, 10.0, 2.0), DENIED),
        ((1.0, math.nan, 10.0, 2.0), DENIED),
        ((1.0, 2.0, 10.0, 2.0), UNSUPPORTED),
        ((1.0, 3.0, 10.0, 2.0), UNSUPPORTED),
        ((1.0, 0.0, 10.0, 2.0, 2.0), UNSUPPORTED),
        ((1.0, 0.0, 10.0, 0.0), DENIED),
        ((1.0, 0.0, 10.0, -1.0), DENIED),
        ((1.0, 0.0, 10.0, LONGEST_NS / 1e9 + 0.1), DENIED),
        ((1.0, 0.0, 10.0, math.nan), DENIED),
        ((1.0, 0.0, 10.0, math.inf), DENIED),
    ],
)
def test_what_is_no_motor_test_turns_nothing(bench, params, result):
    bench.command(TEST, *params)
    assert bench.step(bench.control()) == []
    assert [each for each, _ in acks(bench)] == [result]


def test_a_motor_test_is_asked_for_again_as_long_as_the_station_is_heard(bench):
    request = begun(bench, TEST, *LEFT_10_PERCENT)
    asked_ns = bench.now_ns
    for step in range(200):
        if step % 50 == 0:
            bench.receive(m.MAVLink_heartbeat_message(m.MAV_TYPE_GIMBAL, 8, 0, 0, 4, 3))
            heard_ns = bench.now_ns
        for again in at(bench, request, Outcome.RUNNING, 0.1, state=SafetyState.MOTOR_TEST):
            assert again.request_id == request.request_id
            assert bench.now_ns - asked_ns <= SECOND_NS // 10, "well before it expires"
            asked_ns = bench.now_ns
    assert bench.now_ns - asked_ns <= SECOND_NS // 10
    asked = []
    for _ in range(100):
        asked += at(bench, request, Outcome.RUNNING, 0.1, state=SafetyState.MOTOR_TEST)
    assert isinstance(asked[-1], CancelProcedure)
    assert asked[-1].stamp_ns - heard_ns < 1.6 * SECOND_NS
    bench.take()
    at(bench, request, Outcome.CANCELLED, text="cancelled")
    results, texts = told(bench)
    assert (results[-1], texts) == (FAILED, ["Motor test: who asked for it is silent"])


def test_it_ends_when_the_stations_connection_does(bench):
    request = begun(bench, TEST, *LEFT_10_PERCENT)
    bench.links.clients = ()
    requests = at(bench, request, Outcome.RUNNING, state=SafetyState.MOTOR_TEST)
    assert requests == [CancelProcedure(bench.now_ns, request.request_id)]


@BOTH
def test_cancelling_ends_it_and_is_acknowledged_when_it_has_ended(bench, command):
    request = begun(bench, *command)
    at(bench, request, Outcome.RUNNING, 0.2)
    bench.take()
    cancel(bench, command[0], system=254)
    assert CancelProcedure not in map(type, at(bench, request, Outcome.RUNNING, 0.25))
    cancel(bench, command[0])
    requests = at(bench, request, Outcome.RUNNING, 0.3)
    assert requests == [CancelProcedure(bench.now_ns, request.request_id)]
    assert at(bench, request, Outcome.RUNNING, 0.3) == [], "a wheel is not turned any more"
    bench.take()
    at(bench, request, Outcome.CANCELLED, 0.3, "cancelled")
    assert acks(bench) == [(CANCELLED, 0)]


def test_a_motor_test_that_is_cancelled_before_it_began_turns_nothing(bench):
    bench.command(TEST, *LEFT_10_PERCENT)
    cancel(bench, TEST)
    assert bench.step(bench.control()) == []
    assert acks(bench) == [(CANCELLED, 0)]


@pytest.mark.parametrize("stop", [(TEST, 1.0, 0.0, 0.0), (TEST, 9.0, 1.0, 1500.0, 0.0, 2.0)])
def test_no_throttle_ends_a_test_whoever_says_it(bench, stop):
    request = begun(bench, TEST, *LEFT_10_PERCENT)
    bench.command(*stop, system=254)
    requests = at(bench, request, Outcome.RUNNING)
    assert requests == [CancelProcedure(bench.now_ns, request.request_id)]
    assert (ACCEPTED, 0) in acks(bench)


def test_a_repetition_is_told_the_progress_and_another_one_to_wait(bench):
    request = begun(bench, TEST, *LEFT_10_PERCENT)
    at(bench, request, Outcome.RUNNING, 0.5)
    bench.take()
    bench.command(TEST, *LEFT_10_PERCENT, confirmation=1)
    bench.command(CALIBRATE, 1.0)
    bench.command(TEST, 2.0, 0.0, 10.0, 2.0, system=254)
    requests = at(bench, request, Outcome.RUNNING, 0.5)
    assert {each.request_id for each in requests} <= {request.request_id}
    assert acks(bench) == [(IN_PROGRESS, 50), (LATER, 0), (LATER, 0)]


def test_a_late_copy_turns_nothing(bench):
    params = (*LEFT_10_PERCENT, math.nan, math.nan)
    request = begun(bench, TEST, *params)
    at(bench, request, Outcome.DONE, 1.0)
    bench.take()
    bench.command(TEST, *params, confirmation=1)
    assert bench.step(bench.control()) == []
    assert acks(bench) == [(LATER, 0)]
    bench.run(1.1)
    bench.command(TEST, *params)
    assert bench.step(bench.control()) != []


@pytest.mark.parametrize(("began", "result"), [(False, LATER), (True, FAILED)])
def test_a_control_process_that_does_not_answer_ends_it(bench, began, result):
    request = begun(bench, CALIBRATE, 1.0)
    if began:
        at(bench, request, Outcome.RUNNING, 0.0)
        bench.take()
    bench.run(1.1)
    assert acks(bench) == [(result, 0)]
