"""The behaviour of docs/extending.md is driven as an item of a mission's file."""

import pytest

from robotctl.errors import ConfigError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.planning.behave.mission.mission_file import parse_mission
from tests.planning import conftest

make_run, robot = conftest.make_run, conftest.robot

MISSION = """
name = "back"
world = "flat"
start = {{ x_m = 2.0, y_m = 1.0, heading_deg = 0.0 }}

[[item]]
kind = "back_up"
length_m = {}
"""


def begun(make_run, robot, length_m):
    run = make_run(robot, mission=parse_mission(MISSION.format(length_m), "back.toml"))
    run.step(ModeRequest(Mode.AUTO))
    return run


def test_each_robot_backs_up_by_the_distance(make_run, robot):
    run = begun(make_run, robot, 0.8)
    run.until(lambda out: out.state.mission_completed, 30.0)
    assert run.world.pose.x_m == pytest.approx(1.2, abs=0.1)
    assert run.world.pose.y_m == pytest.approx(1.0, abs=0.05)


def test_an_interruption_keeps_where_it_began(make_run, robot):
    run = begun(make_run, robot, 0.8)
    run.until(lambda _: run.world.pose.x_m < 1.6, 30.0)
    run.step(ModeRequest(Mode.HOLD))
    run.step(ModeRequest(Mode.AUTO))
    run.until(lambda out: out.state.mission_completed, 30.0)
    assert run.world.pose.x_m == pytest.approx(1.2, abs=0.1)


def test_a_distance_that_is_none_is_refused():
    with pytest.raises(ConfigError, match=r"back\.toml:8: .*length_m"):
        parse_mission(MISSION.format(-0.8), "back.toml")
