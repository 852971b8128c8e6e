"""The navigator, whatever the mode: held up, without a pose or readings, armed again."""

import math

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    ModeRequest,
    StickRequest,
    VelocityRequest,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.navigation_step import NavigationInputs
from tests.planning.bench import AUTO, LATER, RTL, ahead, mission


def test_it_begins_in_hold_and_stands(robot, make_run):
    run = make_run(robot)
    out = run.step(VelocityRequest(LATER, 0.5, 0.0), StickRequest(LATER, 1.0, 0.0))
    assert out.state.mode is Mode.HOLD
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


@pytest.mark.parametrize("mode", [AUTO, RTL])
def test_armed_again_after_a_stop_the_robot_does_not_drive_on_by_itself(robot, make_run, mode):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.step(mode)
    run.enabled = False
    assert run.step().v_m_s == 0.0
    run.enabled = True
    for _ in range(40):
        out = run.step()
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, Mode.HOLD)
    assert out.state.message == "hold: the robot was stopped"
    assert out.state.held
    assert not run.step(AUTO).state.held
    run.until(lambda out: out.state.mission_completed, 10.0)


@pytest.mark.parametrize("mode", [AUTO, RTL, ModeRequest(Mode.GUIDED)])
def test_whatever_wants_to_drive_is_slowed_by_the_guard(robot, make_run, monkeypatch, mode):
    """Also something that has forgotten about it; the world fails where the robot touches."""
    wants = BehaviourOutput(0.5, 0.1, text="on", task="a task")
    run = make_run(robot, SE2(2.0, 1.0, math.pi), mission=mission(ahead(3.5)))
    run.step(mode)
    monkeypatch.setattr(run.navigator._modes, "step", lambda *_, **__: wants)
    assert run.step().state.limited_by == ""
    out = run.until(lambda out: out.v_m_s == 0.0, 20.0)
    for _ in range(100):
        out = run.step()
        assert out.state.wanted == (0.5, 0.1, 0.0)
        assert out.omega_rad_s * 0.5 == pytest.approx(out.v_m_s * 0.1)
    assert out.v_m_s == 0.0
    assert out.state.limited_by
    assert out.state.message == f"a task: waiting: {out.state.limited_by}"


def test_by_hand_nothing_slows_the_robot(robot, make_run):
    run = make_run(robot, SE2(0.7, 1.0, math.pi))
    run.step(ModeRequest(Mode.MANUAL))
    state = run.step(StickRequest(LATER, 0.1, 0.0)).state
    assert state.wanted == (pytest.approx(0.08), 0.0, 0.0)
    assert state.limited_by == ""


@pytest.mark.parametrize("gap_s", [0.4, 0.55, 4.8])
def test_a_navigator_held_up_for_seconds_stands_and_goes_on(robot, make_run, gap_s):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.now_ns += round(gap_s * 1e9)
    steps = [run.step() for _ in range(40)]
    assert {each.state.mode for each in steps} == {Mode.AUTO}
    stands = [each.v_m_s == 0.0 for each in steps]
    if gap_s < 0.5:
        assert not any(stands)
    else:
        waited = sum(stands)
        assert 15 <= waited <= 22  # a second of steps in time
        assert all(stands[:waited])
        assert f"held up (a step took that long) for {gap_s + 0.05:.1f}" in steps[0].state.message


def test_a_navigator_held_up_for_longer_holds(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.now_ns += 5_100_000_000
    for _ in range(60):
        out = run.step()
        assert (out.v_m_s, out.state.mode) == (0.0, Mode.HOLD)
    assert out.state.message.startswith("hold: navigation was held up")
    assert run.step(AUTO).v_m_s > 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e308])
def test_an_invalid_pose_or_velocity_stops_the_robot(robot, make_run, bad):
    run = make_run(robot, mission=mission(ahead(3.0)))
    run.step(AUTO)
    ranges = (math.inf,) * 8
    for pose, twist in (
        (SE2(bad, 1.0, 0.0), Twist(0.1, 0.0)),
        (SE2(1.0, -bad, 0.0), Twist(0.1, 0.0)),
        (SE2(1.0, 1.0, 0.0), Twist(math.nan, 0.0)),
    ):
        out = run.navigator.step(
            NavigationInputs(pose, twist, ranges, (run.now_ns,) * 8, True), run.now_ns
        )
        assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)
        assert "no valid pose" in out.state.message
    run.until(lambda out: out.state.mission_completed, 20.0)


@pytest.mark.parametrize("ranges", [(), (1.0,), (math.nan,) * 8])
def test_without_readings_of_its_sonars_the_robot_stands(robot, make_run, ranges):
    run = make_run(robot, mission=mission(ahead(3.0)))
    inputs = NavigationInputs(run.world.pose, Twist(0.0, 0.0), ranges, (0,) * 8, True, (AUTO,))
    out = run.navigator.step(inputs, 0)
    assert out.v_m_s == 0.0
    assert "gives no reading" in out.state.message


def test_recorded_inputs_give_the_same_outputs_bit_for_bit(robot, make_run):
    plan = mission(ahead(3.0), WaitItem("wait", 0.5))
    run = make_run(robot, mission=plan, drift=0.01, range_noise_m=0.02, outliers=0.02)
    recorded, step = [], run.navigator.step

    def recording(inputs, now_ns):
        recorded.append((inputs, now_ns, out := step(inputs, now_ns)))
        return out

    run.navigator.step = recording
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 20.0)
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 30.0)
    replayed = make_run(robot, mission=plan).navigator
    assert len(recorded) > 100
    assert all(replayed.step(inputs, now) == out for inputs, now, out in recorded)


def test_before_the_first_pose_no_breadcrumb_is_dropped(robot, make_run):
    run = make_run(robot, mission=mission(ahead(2.5)))
    unknown = NavigationInputs(
        SE2(math.nan, math.nan, math.nan), Twist(0.0, 0.0), (), (), False, (AUTO,)
    )
    assert "no valid pose" in run.navigator.step(unknown, 0).state.message
    run.until(lambda out: out.state.mission_completed, 20.0)
    before = run.world.distance_m
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 20.0)
    assert run.world.distance_m - before == pytest.approx(1.4, abs=0.25)
