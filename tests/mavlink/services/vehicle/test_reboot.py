"""PREFLIGHT_REBOOT_SHUTDOWN: what the supervisor is asked for, and when it is not."""

import math

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import SafetyState
from robotctl.messages.supervision import Restart, ShutDown
from tests.mavlink.conftest import Bench

REBOOT = m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
ACCEPTED, DENIED, LATER, FAILED, UNSUPPORTED = (
    m.MAV_RESULT_ACCEPTED,
    m.MAV_RESULT_DENIED,
    m.MAV_RESULT_TEMPORARILY_REJECTED,
    m.MAV_RESULT_FAILED,
    m.MAV_RESULT_UNSUPPORTED,
)


def begin(bench, asked, *, there=True):
    """Let telemetry begin with a supervisor that notes what it is asked for."""

    def ask(request):
        asked.append(request)
        return there

    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, ask_supervisor=ask)
    bench.step(bench.control())
    bench.take()
    return bench


@pytest.fixture
def asked():
    return []


def command(bench, *params, confirmation=0, **control):
    """Return the result of the command and what is said."""
    bench.command(REBOOT, *params, confirmation=confirmation)
    bench.step(bench.control(**control))
    sent = [each for each, _ in bench.take()]
    (result,) = [each.result for each in sent if each.get_type() == "COMMAND_ACK"]
    return result, " ".join(x.text for x in sent if x.get_type() == "STATUSTEXT")


@pytest.mark.parametrize("unused", [0.0, 1.0, math.nan])
def test_a_disarmed_robot_at_rest_restarts(bench, asked, unused):
    begin(bench, asked)
    assert command(bench, 1.0, *[unused] * 6) == (ACCEPTED, "")
    assert asked == [Restart(bench.now_ns)]


@pytest.mark.parametrize("state", [SafetyState.ARMED, SafetyState.DRIVING])
@pytest.mark.parametrize("force", [0.0, 20190226.0])
def test_an_armed_robot_refuses_forced_or_not(bench, asked, state, force):
    begin(bench, asked)
    for action in (1.0, 2.0):
        result, said = command(bench, action, 0.0, 0.0, 0.0, 0.0, force, state=state)
        assert result == (LATER if action == 1.0 else UNSUPPORTED)
        assert ("armed" if action == 1.0 else "mavlink.allow_shutdown") in said
    assert asked == []


@pytest.mark.parametrize("motion", [{"v_m_s": -0.1}, {"omega_rad_s": 0.3}])
def test_a_robot_that_still_rolls_refuses(bench, asked, motion):
    begin(bench, asked)
    result, said = command(bench, 1.0, **motion)
    assert result == LATER
    assert "moves" in said
    assert asked == []


def test_a_robot_whose_wheels_are_not_heard_restarts(bench, asked):
    begin(bench, asked)
    states = {"state": SafetyState.BOOT, "v_m_s": math.nan, "omega_rad_s": math.nan}
    assert command(bench, 1.0, **states)[0] == ACCEPTED
    assert len(asked) == 1


def test_a_robot_that_is_about_to_arm_or_whose_control_is_silent_refuses(bench, asked):
    begin(bench, asked)
    bench.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    bench.step(bench.control())
    result, said = command(bench, 1.0)
    assert result == LATER
    assert "arm" in said
    bench = begin(Bench(), asked)
    bench.step(advance_s=2.0)
    bench.take()
    bench.command(REBOOT, 1)
    bench.step()
    assert [each.result for each in bench.messages("COMMAND_ACK")] == [LATER]
    assert asked == []


def test_shutting_down_needs_the_robots_file(asked):
    result, said = command(begin(Bench(), asked), 2.0)
    assert result == UNSUPPORTED
    assert "mavlink.allow_shutdown" in said
    bench = begin(Bench(allow_shutdown=True), asked)
    assert command(bench, 2.0) == (ACCEPTED, "")
    assert asked == [ShutDown(bench.now_ns)]


@pytest.mark.parametrize(
    ("params", "result"),
    [
        ((math.nan,), DENIED),
        ((0.5,), DENIED),
        ((3.0,), UNSUPPORTED),
        ((42.0,), UNSUPPORTED),
        ((0.0, 2.0), UNSUPPORTED),
        ((0.0, 0.0, 1.0, 100.0), UNSUPPORTED),
        ((0.0,), ACCEPTED),
    ],
)
def test_what_asks_for_something_else_restarts_nothing(bench, asked, params, result):
    begin(bench, asked)
    found, said = command(bench, *params)
    assert found == result
    assert bool(said) == (result != ACCEPTED)
    assert asked == []


def test_a_repetition_before_or_after_the_restart_restarts_nothing_again(bench, asked):
    begin(bench, asked)
    command(bench, 1.0)
    assert command(bench, 1.0, confirmation=1) == (ACCEPTED, "")
    begin(bench, asked)
    bench.run(2.0)
    bench.take()
    assert command(bench, 1.0, confirmation=1) == (ACCEPTED, "")
    assert len(asked) == 1
    bench.run(6.0)
    bench.take()
    assert command(bench, 1.0) == (ACCEPTED, "")
    assert len(asked) == 2


def test_without_a_supervisor_it_fails(bench, asked):
    begin(bench, asked, there=False)
    result, said = command(bench, 1.0)
    assert result == FAILED
    assert "supervisor" in said
