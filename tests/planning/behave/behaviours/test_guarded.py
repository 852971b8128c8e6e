"""Behaviours under supervision: obstacles and time."""

import numpy as np

from robotctl.planning.behave.behaviours.follow_path import DriveItem
from tests.planning.bench import AUTO, HOLD, ahead, mission


def box(x0, y0, x1, y1):
    return np.array([(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)])


def test_the_robot_waits_for_an_obstacle_and_goes_on_when_it_is_gone(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.world.obstacle = box(2.8, 0.8, 3.0, 1.2)
    run.step(AUTO)
    out = run.until(lambda out: "waiting" in out.state.message, 15.0)
    assert "front measures" in out.state.message
    for _ in range(60):
        out = run.step()
    assert run.world.twist.v_m_s == 0.0
    run.world.obstacle = None
    run.until(lambda out: out.state.mission_completed, 15.0)
    assert run.world.touched == 0


def test_a_robot_blocked_for_too_long_gives_up_with_the_reason_and_can_go_on_later(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.world.obstacle = box(2.8, 0.8, 3.0, 1.2)
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 30.0)
    assert 'item 1 "ahead" (drive): blocked for 10 s: front measures' in out.state.message
    assert not out.state.mission_completed
    assert run.step().v_m_s == 0.0
    run.world.obstacle = None
    run.step(HOLD)
    assert not run.step(AUTO).state.mission_failed
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 30.0)
    assert out.state.mission_completed, out.state.message


def test_each_time_the_way_is_blocked_the_patience_begins_anew(robot, make_run):
    run = make_run(robot, mission=mission(ahead(4.0)))
    for x in (2.2, 3.2):
        run.world.obstacle = box(x, 0.8, x + 0.2, 1.2)
        out = run.step(AUTO) if x < 3.0 else run.step()
        run.until(lambda out: "waiting" in out.state.message, 15.0)
        for _ in range(140):  # 7 of 10 seconds
            out = run.step()
        assert not out.state.mission_failed
        run.world.obstacle = None
    run.until(lambda out: out.state.mission_completed, 15.0)


def test_an_item_over_its_time_fails_with_the_reason(robot, make_run):
    item = DriveItem("drive", ((1.0, 1.0), (4.0, 1.0)), time_out_s=2.0)
    run = make_run(robot, mission=mission(item))
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 3.0)
    assert "not done after 2 s" in out.state.message
