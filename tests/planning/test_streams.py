"""Streams of positions in GUIDED: as good as one message, whatever their rate."""

import math

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, PositionRequest
from robotctl.planning.config import NavigationConfig
from robotctl.planning.navigation_step import NavigationInputs
from robotctl.planning.navigator import Navigator
from tests.planning.behave.journey.bench import DRIVE, DT_S, START, Bench, room, scan_of

GOAL = (5.0, 2.6)
GUIDED = ModeRequest(Mode.GUIDED)


class Streamed:
    """A robot with a map, in GUIDED, to which something sends positions."""

    def __init__(self, world=None):
        self.bench = Bench(room() if world is None else world, room())
        limits = LimitsConfig(0.8, 2.0, 2.0, 6.0, 30.0, 100.0)
        config = NavigationConfig(guided_speed_m_s=0.8)
        self.navigator = Navigator(config, DRIVE, limits, (), None, START, lidars=1)
        self.navigator.take_pilot(self.bench.pilot)
        self.planned_ns = []
        plan = self.bench.pilot.tools.paths.plan

        def counted(pose, goal):
            self.planned_ns.append(self.bench.now_ns)
            return plan(pose, goal)

        self.bench.pilot.tools.paths.plan = counted
        self.out = self.step(GUIDED)

    def step(self, *requests):
        bench = self.bench
        scan = scan_of(bench.world, bench.pose, bench.now_ns)
        inputs = NavigationInputs(
            bench.pose, bench.twist, (), (), True, requests, scans=((bench.pose, scan),)
        )
        self.out = self.navigator.step(inputs, bench.now_ns)
        bench.move(self.out.v_m_s, self.out.omega_rad_s)
        return self.out

    def drive(self, goal_at, every, seconds=30.0):
        """Send a position every so many steps; return when the robot was there first [s]."""
        begin_ns, there_s, gears = self.bench.now_ns, None, []
        for k in range(round(seconds / DT_S)):
            time_s = k * DT_S
            goal = goal_at(time_s)
            out = self.step(*([PositionRequest(*goal)] if k % every == 0 else ()))
            gears += [math.copysign(1.0, out.v_m_s)] if abs(out.v_m_s) > 0.01 else []
            if there_s is None and out.state.goal_reached:
                there_s = (self.bench.now_ns - begin_ns) * 1e-9
        self.reversals = int(np.count_nonzero(np.diff(gears)))
        return there_s

    def away_m(self, goal):
        return math.dist((self.bench.pose.x_m, self.bench.pose.y_m), goal)


ONCE = 10**6


@pytest.fixture(scope="module")
def once():
    run = Streamed()
    return run.drive(lambda _: GOAL, ONCE), run.away_m(GOAL)


@pytest.mark.parametrize("every", [1, 2, 4], ids=["20 Hz", "10 Hz", "5 Hz"])
def test_the_same_position_again_and_again_is_as_one_message(once, every):
    time_s, away_m = once
    run = Streamed()
    assert run.drive(lambda _: GOAL, every) == pytest.approx(time_s, rel=0.05)
    assert run.away_m(GOAL) == pytest.approx(away_m, abs=0.01)
    assert run.reversals == 0


@pytest.mark.parametrize("every", [1, 2], ids=["20 Hz", "10 Hz"])
def test_a_position_that_shakes_is_planned_to_twice_a_second_at_most(once, every):
    time_s, _ = once
    run = Streamed()

    def shaken(t):
        return GOAL[0] + 0.04 * math.cos(47.0 * t), GOAL[1] + 0.04 * math.sin(47.0 * t)

    assert 0.85 * time_s < run.drive(shaken, every) < 1.05 * time_s
    assert run.away_m(GOAL) < 0.1
    assert np.diff(run.planned_ns).min() >= 500_000_000
    assert run.reversals <= 4


def test_a_position_that_moves_on_is_followed():
    run = Streamed()
    run.drive(lambda t: (min(1.5 + 0.3 * t, 5.0), 2.0 + 0.1 * math.sin(0.5 * t)), 1, seconds=9.0)
    assert run.away_m((1.5 + 0.3 * 9.0, 2.0)) < 0.5
    assert np.diff(run.planned_ns).min() >= 500_000_000
    assert run.reversals == 0


def test_a_place_that_cannot_be_reached_is_planned_to_twice_a_second_at_most():
    run = Streamed()
    run.drive(lambda t: (5.98, 2.0 + 0.02 * math.sin(31.0 * t)), 1, seconds=5.0)
    assert run.out.state.goal_reached is not True
    assert np.diff(run.planned_ns).min() >= 500_000_000
    assert run.drive(lambda _: GOAL, 1) is not None


def test_the_same_place_in_a_wall_is_refused_once_and_tried_again_after_a_pause():
    run = Streamed()
    run.drive(lambda _: (5.98, 2.0), 1, seconds=3.0)
    assert run.out.state.goal_reached is False
    assert "lies in an obstacle" in run.out.state.message
    tried = len(run.planned_ns)
    assert tried == 1
    for _ in range(40):
        run.step()
    run.step(PositionRequest(5.98, 2.0))
    assert len(run.planned_ns) == tried + 1


def test_another_speed_counts_at_once():
    run = Streamed()
    run.drive(lambda _: GOAL, 1, seconds=2.0)
    run.navigator.retune({"navigation.guided_speed_m_s": 0.2})
    run.drive(lambda _: GOAL, 1, seconds=1.5)
    assert run.out.v_m_s < 0.23
