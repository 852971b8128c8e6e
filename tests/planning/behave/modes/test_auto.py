"""AUTO: missions, in order and interrupted."""

import math

import pytest

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    StickRequest,
)
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.behaviours.turn_to import TurnToItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from tests.planning.bench import AUTO, HOLD, LATER, MANUAL, ahead, mission


def test_auto_without_a_mission_is_refused_with_the_reason(robot, make_run):
    run = make_run(robot)
    out = run.step(AUTO)
    assert out.state.mode is Mode.HOLD
    assert "no mission is loaded" in out.state.message
    assert run.navigator.refusal(Mode.AUTO)
    assert not run.navigator.refusal(Mode.RTL)


def test_a_mission_that_the_robot_cannot_drive_is_refused_at_once(steered, make_run):
    with pytest.raises(MissionError, match="item 1"):
        make_run(steered, mission=mission(TurnToItem("turn_to", 90.0)))


def test_items_run_in_their_order(differential, make_run):
    plan = mission(WaitItem("wait", 1.0), TurnToItem("turn_to", 90.0), ahead(2.0))
    run = make_run(differential, mission=plan)
    run.step(AUTO)
    run.until(lambda out: out.state.item == 1, 1.2)
    out = run.until(lambda out: out.state.item == 2, 5.0)
    assert run.world.pose.theta_rad == pytest.approx(math.pi / 2, abs=0.06)
    assert out.state.item_name == "ahead"
    out = run.until(lambda out: out.state.mission_completed, 20.0)
    assert (out.state.item, out.state.items, out.state.item_name) == (3, 3, "")
    assert run.world.pose.x_m == pytest.approx(2.0, abs=0.07)


def test_while_not_armed_nothing_moves_and_no_time_passes(robot, make_run):
    run = make_run(robot, mission=mission(WaitItem("wait", 1.0), ahead(2.0)))
    run.enabled = False
    run.step(AUTO)
    for _ in range(100):
        out = run.step()
        assert (out.v_m_s, out.state.item) == (0.0, 0)
    run.enabled = True
    run.until(lambda out: out.state.item == 1, 1.2)


def test_an_interrupted_mission_goes_on_where_it_was_left(robot, make_run):
    run = make_run(robot, mission=mission(WaitItem("wait", 0.5), ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    out = run.step(HOLD)
    assert (out.v_m_s, out.state.item) == (0.0, 1)
    run.step(MANUAL, StickRequest(LATER, 0.3, 0.0))
    for _ in range(20):
        run.step()
    before = run.now_ns
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 10.0)
    assert (run.now_ns - before) / 1e9 < 6.0
    assert min(pose.x_m for pose in run.trace[-40:]) > 2.0


@pytest.mark.parametrize("other", [HOLD, MANUAL], ids=["hold", "manual"])
def test_time_in_another_mode_is_no_time_of_the_item(robot, make_run, other):
    way = StraightToItem("straight_to", 4.0, 1.0, name="away", time_out_s=30.0)
    run = make_run(robot, mission=mission(WaitItem("wait", 20.0), way))

    def drive_a_second_and_pause_for_40():
        for _ in range(20):
            run.step()
        run.step(other)
        for _ in range(20 * 40):
            run.step()
        run.step(AUTO)

    run.step(AUTO)
    drive_a_second_and_pause_for_40()
    began_ns = run.now_ns
    run.until(lambda out: out.state.item == 1, 25.0)
    assert run.now_ns - began_ns == pytest.approx(19e9, abs=0.2e9)
    drive_a_second_and_pause_for_40()
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 29.0)
    assert out.state.mission_completed, out.state.message


def test_asking_for_auto_again_repeats_a_completed_mission(differential, make_run):
    run = make_run(differential, mission=mission(WaitItem("wait", 0.2)))
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 1.0)
    assert run.step().state.mission_completed
    assert not run.step(AUTO).state.mission_completed
    run.until(lambda out: out.state.mission_completed, 1.0)
