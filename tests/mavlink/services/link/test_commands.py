"""Commands: what they ask of the other processes, and how they are acknowledged."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import MAX_PENDING
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import (
    Ack,
    Arm,
    EmergencyStop,
    EmergencyStopSource,
    Mode,
    Notice,
    SafetyState,
    SetMode,
    Severity,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.mavlink_port import Peer
from robotctl.messages.requests import REQUEST_LIFE_NS

ARM = common.MAV_CMD_COMPONENT_ARM_DISARM
TERMINATE = common.MAV_CMD_DO_FLIGHTTERMINATION
SET_MODE = common.MAV_CMD_DO_SET_MODE
REQUEST = common.MAV_CMD_REQUEST_MESSAGE
ACCEPTED, BUSY = common.MAV_RESULT_ACCEPTED, common.MAV_RESULT_TEMPORARILY_REJECTED
IN_PROGRESS = common.MAV_RESULT_IN_PROGRESS
DENIED, UNSUPPORTED = common.MAV_RESULT_DENIED, common.MAV_RESULT_UNSUPPORTED


def results(bench):
    return [ack.result for ack in bench.messages("COMMAND_ACK")]


def test_arming_is_acknowledged_when_control_has_armed(bench):
    bench.command(ARM, 1, system=255, component=190, peer=Peer(0, 3))
    (request,) = bench.step()
    assert isinstance(request, Arm)
    assert request.arm
    assert results(bench) == []
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=True),)))
    ((ack, target),) = bench.take("COMMAND_ACK")
    assert (ack.command, ack.result) == (ARM, ACCEPTED)
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert target == Peer(0, 3)


def test_an_answer_to_another_request_acknowledges_nothing(bench):
    bench.command(ARM, 1)
    (request,) = bench.step(bench.control(acks=(Ack(1, accepted=True),)))
    bench.step(bench.control(acks=(Ack(request.request_id - 1, accepted=True),)))
    assert results(bench) == []


def test_a_refusal_is_denied_and_its_reasons_are_said(bench):
    bench.command(ARM, 1)
    (request,) = bench.step()
    reasons = (
        Fault(FaultCode.NODE_SILENT, "node 2 (sonar) is missing", "sonar"),
        Fault(FaultCode.EMERGENCY_STOP, "emergency stop"),
    )
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=False, reasons=reasons),)))
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [DENIED]
    texts = [m.text for m, _ in sent if m.get_type() == "STATUSTEXT"]
    assert texts == ["Arm: node 2 (sonar) is missing", "Arm: emergency stop"]


def test_without_an_answer_arming_is_temporarily_rejected(bench):
    bench.command(ARM, 1)
    bench.step()
    bench.run(1.1)
    assert results(bench) == []
    bench.run(0.8)
    assert results(bench) == [IN_PROGRESS]
    bench.run(0.2)
    assert results(bench) == [BUSY]


def test_a_robot_that_takes_its_time_to_arm_is_given_it(make_bench):
    bench = make_bench()
    robot = TelemetryRobot("tester", "1.2.3", arm_timeout_s=4.0)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.command(ARM, 1)
    (request,) = bench.step()
    bench.run(4.5)
    assert results(bench) == [IN_PROGRESS] * 3
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=True),)))
    assert results(bench) == [ACCEPTED]


def test_an_arm_request_repeated_while_it_is_carried_out_is_not_sent_twice(bench):
    bench.command(ARM, 1)
    (request,) = bench.step()
    bench.command(ARM, 1, confirmation=1)
    bench.command(ARM, 1, peer=Peer(0, 9))
    assert bench.step() == []
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=True),)))
    acks = [(ack.result, peer) for ack, peer in bench.take("COMMAND_ACK")]
    assert acks == [(ACCEPTED, Peer(0, 0)), (ACCEPTED, Peer(0, 9))], "one on each connection"


@pytest.mark.parametrize("unused", [0.0, math.nan])
def test_a_late_copy_of_an_arm_request_does_not_arm_a_stopped_robot(bench, unused):
    bench.command(ARM, 1, *[unused] * 6)
    (request,) = bench.step()
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=True),)))
    bench.command(TERMINATE, 1)
    assert isinstance(bench.step()[0], EmergencyStop)
    bench.take()
    bench.command(ARM, 1, *[unused] * 6, confirmation=1)
    assert bench.step() == []
    assert results(bench) == [BUSY]
    bench.run(1.1)
    bench.command(ARM, 1)
    assert isinstance(bench.step()[0], Arm)


def test_a_copy_of_an_arm_request_to_a_robot_that_is_armed_gets_the_same_answer(bench):
    bench.command(ARM, 1)
    (request,) = bench.step()
    ack = Ack(request.request_id, accepted=True)
    bench.step(bench.control(acks=(ack,), state=SafetyState.ARMED))
    bench.take()
    bench.command(ARM, 1, confirmation=1)
    assert bench.step() == []
    assert results(bench) == [ACCEPTED]


def test_disarming_is_always_carried_out_even_behind_an_arm_request(bench):
    bench.command(ARM, 1)
    bench.command(ARM, 0)
    bench.command(ARM, 0)
    requests = bench.step()
    assert [request.arm for request in requests] == [True, False, False]
    bench.step(bench.control(acks=(Ack(requests[0].request_id, accepted=True),)))
    bench.step(bench.control(acks=(Ack(requests[2].request_id, accepted=True),)))
    bench.run(3.0)
    assert results(bench) == [ACCEPTED, ACCEPTED]


def test_many_who_ask_at_once_do_not_keep_anybody_from_disarming(bench):
    for system in range(100, 100 + MAX_PENDING + 1):
        bench.command(ARM, 1, system=system)
    asked = bench.step()
    assert len(asked) == MAX_PENDING
    ((ack, _),) = bench.take("COMMAND_ACK")
    assert (ack.result, ack.target_system) == (BUSY, 100 + MAX_PENDING)
    bench.command(ARM, 0)
    (disarm,) = bench.step()
    assert not disarm.arm
    assert results(bench) == [BUSY]
    answers = tuple(Ack(request.request_id, accepted=True) for request in asked)
    bench.step(bench.control(acks=answers))
    assert results(bench) == [ACCEPTED] * MAX_PENDING


def test_request_numbers_differ_after_a_restart(make_bench):
    numbers = set()
    for start in (10, 20):
        bench = make_bench()
        bench.now_ns = start * 1_000_000_000
        for arm in (1, 0, 0):
            bench.command(ARM, arm)
        numbers |= {request.request_id for request in bench.step()}
    assert len(numbers) == 6


@pytest.mark.parametrize("command", [(ARM, 0, 21196), (TERMINATE, 1)])
def test_forced_disarm_and_flight_termination_are_emergency_stops(bench, command):
    bench.command(*command)
    (request,) = bench.step()
    assert isinstance(request, EmergencyStop)
    assert request.source == EmergencyStopSource.GROUND_STATION
    assert results(bench) == [ACCEPTED]


def test_forced_arming_is_arming(bench):
    bench.command(ARM, 1, 21196)
    assert isinstance(bench.step()[0], Arm)


@pytest.mark.parametrize(
    "command", [(ARM, 0.5), (ARM, math.nan), (ARM, 2), (TERMINATE, 0), (TERMINATE, math.nan)]
)
def test_commands_that_say_neither_yes_nor_no_do_nothing(bench, command):
    bench.command(*command)
    assert bench.step() == []
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [DENIED]
    assert [m for m, _ in sent if m.get_type() == "STATUSTEXT"]


def test_command_int_does_the_same(bench):
    bench.receive(common.MAVLink_command_int_message(1, 1, 0, TERMINATE, 0, 0, 1, 0, 0, 0, 0, 0, 0))
    assert isinstance(bench.step()[0], EmergencyStop)
    assert results(bench) == [ACCEPTED]


def test_a_mode_is_acknowledged_when_navigation_has_taken_it(bench):
    bench.command(SET_MODE, 1, 15)
    before = bench.navigation(mode=Mode.GUIDED)  # stamped no later than the request
    (request,) = bench.step(before)
    assert request == SetMode(bench.now_ns, Mode.GUIDED)
    assert results(bench) == []
    bench.step(bench.navigation(mode=Mode.HOLD))
    assert results(bench) == []
    bench.step(bench.navigation(mode=Mode.GUIDED))
    assert results(bench) == [ACCEPTED]


def test_the_pre_arm_checks_say_all_that_speaks_against_arming(bench):
    against = (
        Fault(FaultCode.BATTERY_LOW, "the battery is low (10.1 V)"),
        Fault(FaultCode.BUS_PASSIVE, "the CAN bus is error passive"),
    )
    for state, result in ((SafetyState.STANDBY, ACCEPTED), (SafetyState.ARMED, BUSY)):
        bench.command(common.MAV_CMD_RUN_PREARM_CHECKS)
        assert bench.step(bench.control(state=state, against_arming=against)) == []
        sent = bench.take()
        assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [result]
        texts = [m.text for m, _ in sent if m.get_type() == "STATUSTEXT"]
        said = [f"PreArm: {each}" for each in against] if result == ACCEPTED else []
        assert texts == said


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (SafetyState.FAULT, ["Mode GUIDED: arm to drive, the state is FAULT: ouch"]),
        (
            SafetyState.EMERGENCY_STOP,
            ["Mode GUIDED: arm to drive, the state is EMERGENCY_STOP: ouch"],
        ),
        (SafetyState.STANDBY, []),
        (SafetyState.ARMED, []),
    ],
)
def test_what_a_mode_needs_before_it_drives_is_said_once(bench, state, said):
    for _ in range(3):
        bench.command(SET_MODE, 1, 15)
        for _ in range(2):
            bench.step(
                bench.control(state=state, reason="ouch"), bench.navigation(mode=Mode.GUIDED)
            )
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [ACCEPTED] * 3
    text = "".join(m.text for m, _ in sent if m.get_type() == "STATUSTEXT")
    assert text == "".join(said)


@pytest.mark.parametrize(
    ("number", "param", "mode"),
    [
        (common.MAV_CMD_NAV_RETURN_TO_LAUNCH, math.nan, Mode.RTL),
        (common.MAV_CMD_DO_PAUSE_CONTINUE, 0, Mode.HOLD),
        (common.MAV_CMD_DO_PAUSE_CONTINUE, 1, Mode.AUTO),
    ],
)
def test_commands_that_mean_a_mode_are_acknowledged_as_a_mode_is(bench, number, param, mode):
    bench.command(number, param)
    assert bench.step() == [SetMode(bench.now_ns, mode)]
    assert results(bench) == []
    bench.step(bench.navigation(mode=mode))
    assert results(bench) == [ACCEPTED]


@pytest.mark.parametrize("param", [2, 0.5, math.nan])
def test_a_pause_that_is_none_is_denied(bench, param):
    bench.command(common.MAV_CMD_DO_PAUSE_CONTINUE, param)
    assert bench.step() == []
    assert results(bench) == [DENIED]


def test_a_mode_that_is_not_taken_is_rejected_with_navigations_reason(bench):
    bench.command(SET_MODE, 1, 10)
    bench.step()
    bench.run(0.9)
    assert results(bench) == []
    bench.step(bench.navigation(message="no mission"))
    bench.step(bench.navigation(message="no mission"), advance_s=0.2)
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [BUSY]
    texts = [m.text for m, _ in sent if m.get_type() == "STATUSTEXT"]
    assert texts == ["Mode AUTO not taken: no mission"]


def test_a_mode_that_navigation_takes_at_the_last_moment_is_accepted(bench):
    """Not before navigation drops the request by itself is it said to be rejected."""
    bench.command(SET_MODE, 1, 10)
    bench.step()
    bench.run(REQUEST_LIFE_NS / 1e9 + 0.06)  # a step of navigation, and the way of its state
    assert results(bench) == []
    bench.step(bench.navigation(mode=Mode.AUTO))
    assert results(bench) == [ACCEPTED]


def test_a_newer_mode_replaces_an_older_one(bench):
    bench.command(SET_MODE, 1, 10)
    bench.command(SET_MODE, 1, 4)
    assert [request.mode for request in bench.step()] == [Mode.AUTO, Mode.HOLD]
    bench.step(bench.navigation(mode=Mode.HOLD))
    assert results(bench) == [BUSY, ACCEPTED]


def test_a_repeated_mode_command_is_carried_out_once(bench):
    bench.command(SET_MODE, 1, 10)
    bench.command(SET_MODE, 1, 10, confirmation=1)
    assert len(bench.step()) == 1


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL])
def test_all_who_ask_for_the_same_mode_at_once_are_told_that_it_was_taken(bench, mode):
    """Ground stations may have the same ids, as those have that nobody has given others."""
    bench.command(SET_MODE, 1, mode)
    bench.receive(common.MAVLink_set_mode_message(1, 1, mode))
    bench.command(SET_MODE, 1, mode, system=254, peer=Peer(0, 1))
    bench.command(SET_MODE, 1, mode, peer=Peer(0, 2))
    assert bench.step()
    bench.step(bench.navigation(mode=mode))
    acks = {(ack.result, ack.target_system, peer) for ack, peer in bench.take("COMMAND_ACK")}
    assert acks == {
        (ACCEPTED, 255, Peer(0, 0)),
        (ACCEPTED, 254, Peer(0, 1)),
        (ACCEPTED, 255, Peer(0, 2)),
    }


def test_of_many_who_ask_for_a_mode_at_once_eight_wait_and_hold_is_asked_for_always(bench):
    senders = range(100, 100 + 2 * MAX_PENDING)
    for system in senders:
        bench.command(SET_MODE, 1, Mode.AUTO, system=system)
    assert [request.mode for request in bench.step()] == [Mode.AUTO] * MAX_PENDING
    answers = [(ack.result, ack.target_system) for ack, _ in bench.take("COMMAND_ACK")]
    assert answers == [(BUSY, system) for system in senders[MAX_PENDING:]]
    for system in senders:
        bench.command(SET_MODE, 1, Mode.HOLD, system=system)
    assert [request.mode for request in bench.step()] == [Mode.HOLD] * len(senders)
    assert results(bench) == [BUSY] * len(senders)
    bench.step(bench.navigation(mode=Mode.HOLD))
    assert results(bench) == [ACCEPTED] * MAX_PENDING


def test_two_with_the_same_ids_who_disarm_at_once_are_both_answered(bench):
    bench.command(ARM, 0)
    bench.command(ARM, 0, peer=Peer(0, 1))
    first, second = bench.step()
    answers = (Ack(first.request_id, accepted=True), Ack(second.request_id, accepted=True))
    bench.step(bench.control(acks=answers))
    acks = [(ack.result, peer) for ack, peer in bench.take("COMMAND_ACK")]
    assert acks == [(ACCEPTED, Peer(0, 0)), (ACCEPTED, Peer(0, 1))]


@pytest.mark.parametrize(
    "params", [(1, 3), (1, 15.5), (1, math.nan), (0, 15), (math.nan, 15), (1, -1), (math.inf, 4)]
)
def test_modes_that_a_rover_does_not_have_are_denied_with_the_list(bench, params):
    bench.command(SET_MODE, *params)
    assert bench.step() == []
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [DENIED]
    text = "".join(m.text for m, _ in sent if m.get_type() == "STATUSTEXT")
    assert "GUIDED 15" in text or "CUSTOM_MODE_ENABLED" in text


def test_nonsense_asked_for_again_and_again_does_not_hide_why_the_robot_stands(bench):
    stopped = [Notice(0, Severity.WARNING, "stopped: no feedback")]
    texts = []
    for step in range(100):
        for number in range(100, 200):
            bench.command(SET_MODE, 1, number)
        bench.step(*(stopped if step == 50 else []))
        texts += bench.texts()
    assert "stopped: no feedback" in texts


def test_the_old_set_mode_message_works_and_has_no_acknowledgement(bench):
    bench.receive(common.MAVLink_set_mode_message(1, 1, 0))
    assert [request.mode for request in bench.step()] == [Mode.MANUAL]
    bench.receive(common.MAVLink_set_mode_message(1, 1, 99))
    assert bench.step() == []
    assert results(bench) == []


def test_messages_may_be_asked_for_once(bench):
    bench.run(0.5)
    bench.take()
    for number in (148, 30, 0, 1):
        bench.command(REQUEST, number, peer=Peer(0, 4))
    bench.step(bench.control())
    asked = [message.get_type() for message, target in bench.take() if target == Peer(0, 4)]
    names = [name for name in asked if name != "COMMAND_ACK"]
    assert names == ["AUTOPILOT_VERSION", "ATTITUDE", "HEARTBEAT", "SYS_STATUS"]
    assert len(asked) == 8


def test_a_message_with_nothing_to_say_is_temporarily_rejected(bench):
    """ODOMETRY before control is heard; BATTERY_STATUS of a robot without a battery."""
    bench.command(REQUEST, common.MAVLINK_MSG_ID_ODOMETRY)
    bench.step()
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [BUSY]
    assert not [m for m, _ in sent if m.get_type() == "ODOMETRY"]
    bench.run(0.2, battery=None)
    bench.take()
    for number in (common.MAVLINK_MSG_ID_BATTERY_STATUS, common.MAVLINK_MSG_ID_ODOMETRY):
        bench.command(REQUEST, number)
    bench.step()
    assert results(bench) == [BUSY, ACCEPTED]


@pytest.mark.parametrize("number", [124, 99999, math.nan, math.inf, -1, 30.5])
def test_messages_that_are_not_ours_are_denied(bench, number):
    bench.command(REQUEST, number)
    bench.step()
    assert results(bench) == [DENIED]


def test_the_autopilot_version_tells_version_and_capabilities(bench):
    bench.command(common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    bench.step()
    (version,) = bench.messages("AUTOPILOT_VERSION")
    assert version.flight_sw_version == (1 << 24) + (2 << 16) + (3 << 8) + 255
    assert version.capabilities & common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert version.capabilities & common.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert version.capabilities & common.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    assert version.capabilities & common.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    assert version.uid != 0


@pytest.mark.parametrize("number", [common.MAV_CMD_NAV_TAKEOFF, common.MAV_CMD_DO_PARACHUTE, 65535])
def test_other_commands_are_unsupported(bench, number):
    bench.command(number, 1)
    assert bench.step() == []
    assert results(bench) == [UNSUPPORTED]


@pytest.mark.parametrize(
    ("target", "taken"),
    [((1, 1), True), ((0, 0), True), ((1, 0), True), ((2, 1), False), ((1, 2), False)],
)
def test_only_commands_for_this_robot_are_taken(bench, target, taken):
    bench.command(TERMINATE, 1, target=target)
    assert bool(bench.step()) == taken
    assert bool(results(bench)) == taken


def test_our_own_messages_that_come_back_are_not_taken(bench):
    bench.command(TERMINATE, 1, system=1, component=1)
    assert bench.step() == []


def test_time_is_told_to_those_who_ask(bench):
    bench.receive(common.MAVLink_timesync_message(0, 1234))
    bench.receive(common.MAVLink_timesync_message(99, 1234))  # an answer to somebody else
    bench.step()
    (answer,) = bench.messages("TIMESYNC")
    assert (answer.tc1, answer.ts1) == (bench.now_ns, 1234)


FLOAT32 = st.floats(width=32)


@settings(max_examples=200, deadline=None)
@given(
    number=st.sampled_from([ARM, TERMINATE, SET_MODE, REQUEST, 511, 510, 520, 22]),
    params=st.lists(st.sampled_from([0.0, 1.0, 21196.0]) | FLOAT32, min_size=7, max_size=7),
)
def test_any_parameters_lead_to_a_documented_request_or_a_refusal(make_bench, number, params):
    bench = make_bench()
    bench.command(number, *params)
    requests = bench.step()
    acks = results(bench)
    assert len(requests) <= 1
    assert len(acks) <= 1
    assert requests or acks
    for request in requests:
        if isinstance(request, Arm):
            assert number == ARM
            assert params[0] == float(request.arm)
        elif isinstance(request, SetMode):
            assert number == SET_MODE
            assert params[1] == request.mode
        else:
            assert isinstance(request, EmergencyStop)
            assert number in (ARM, TERMINATE)
    if acks == [ACCEPTED]:
        assert requests or number in (REQUEST, 511, 510, 520)
