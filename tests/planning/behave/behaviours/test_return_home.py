"""The way home: by plan where there is a map or a lidar, else the way the robot came."""

import math

import pytest

from robotctl.messages.mode import Mode
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.return_home import RETURN_HOME, PlannedReturn, ReturnHome
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from tests.planning.behave.journey.bench import DRIVE, Bench, room

CONFIG = NavigationConfig(return_speed_m_s=0.5)
AWAY = [(1.0 + 0.1 * step, 2.0) for step in range(26)]
ROUND = [
    *[(1.0, 2.0 - 0.1 * step) for step in range(13)],
    *[(1.0 + 0.1 * step, 0.8) for step in range(26)],
    *[(3.5, 0.8 + 0.1 * step) for step in range(13)],
]


def returning(bench, way, *, pilot=True, rally=()):
    """Return the behaviour of a robot that came a way, and its breadcrumbs."""
    crumbs = Breadcrumbs(SE2(1.0, 2.0, 0.0), steered=False)
    for x, y in way:
        crumbs.record(SE2(x, y, 0.0))
    guard = ObstacleGuard(CONFIG.guard, ())
    planner = bench.pilot if pilot else None
    robot = NavigatedRobot(CONFIG, DRIVE, (), guard, crumbs, pilot=planner, rally=rally)
    return RETURN_HOME.make(Mode.RTL, robot), crumbs


def drive(bench, behaviour, seconds=60.0):
    """Return how a behaviour ends, and the greatest distance from y = 2."""
    off, end_ns = 0.0, bench.now_ns + round(seconds * 1e9)
    while bench.now_ns < end_ns:
        bench.look()
        step = behaviour.step(BehaviourInput(bench.pose, bench.twist, (), ()), bench.now_ns)
        bench.texts.append(step.text)
        if step.status is not Status.RUNNING:
            return step, off
        bench.move(step.v_m_s, step.omega_rad_s)
        off = max(off, abs(bench.pose.y_m - 2.0))
    raise AssertionError(bench.texts[-3:])


@pytest.mark.parametrize("grid", [room(), None])
def test_home_is_reached_by_the_short_way_not_the_one_it_came(grid):
    bench = Bench(room(), grid, start=SE2(3.5, 2.0, 0.0), config=CONFIG)
    bench.look()
    behaviour, _ = returning(bench, ROUND)
    assert isinstance(behaviour, PlannedReturn)
    step, off = drive(bench, behaviour)
    assert (step.status, step.text) == (Status.DONE, "home")
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (1.0, 2.0)) < 0.15
    assert off < 0.6


def test_where_a_gap_is_in_the_way_it_came_home_is_reached_by_plan():
    bench = Bench(room(), room(), start=SE2(3.5, 2.0, 0.0), config=CONFIG)
    behaviour, crumbs = returning(bench, [(3.5, 2.0)])
    assert crumbs.has_gap
    assert drive(bench, behaviour)[0].text == "home"


def test_a_plan_that_fails_is_told_and_the_way_it_came_is_driven():
    wrong = room()
    wrong[:, 45] = 100  # a wall that is not there, or not any more
    bench = Bench(room(), wrong, start=SE2(3.5, 2.0, 0.0), config=CONFIG)
    behaviour, _ = returning(bench, AWAY)
    step, _ = drive(bench, behaviour)
    assert (step.status, step.text) == (Status.DONE, "home")
    assert any(text.startswith("back the way it came (") for text in bench.texts)
    behaviour, _ = returning(bench, [(3.5, 2.0)])
    bench.pose = SE2(3.5, 2.0, 0.0)
    step, _ = drive(bench, behaviour)
    assert step.status is Status.FAILED
    assert "does not know all of the way it came" in step.text


def test_a_robot_without_map_and_lidar_drives_the_way_it_came():
    bench = Bench(room(), start=SE2(3.5, 2.0, math.pi), config=CONFIG)
    behaviour, _ = returning(bench, AWAY, pilot=False)
    assert isinstance(behaviour, ReturnHome)
    step, off = drive(bench, behaviour)
    assert step.text == "home"
    assert off < 0.2


def test_the_nearest_rally_point_that_a_way_leads_to_takes_the_place_of_home():
    bench = Bench(room(), room(), start=SE2(3.5, 2.0, 0.0), config=CONFIG)
    behaviour, _ = returning(bench, AWAY, rally=((1.2, 0.8), (90.0, 2.0), (2.5, 0.8)))
    step, _ = drive(bench, behaviour)
    assert (step.status, step.text) == (Status.DONE, "at a rally point")
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (2.5, 0.8)) < 0.15
    behaviour, _ = returning(bench, AWAY, rally=((90.0, 2.0),))
    step, _ = drive(bench, behaviour)
    assert step.text == "home"
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (1.0, 2.0)) < 0.15
