"""What a robot in trouble tries, in the order of its file."""

import math
from typing import get_args

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.recovery import Ladder
from robotctl.planning.behave.journey.rungs import RUNGS, Ask, Retrace
from robotctl.planning.behave.mission.mission_file import parse_mission
from robotctl.planning.behave.mission.runner import MissionRunner
from robotctl.planning.config import NavigationConfig, RecoveryConfig, RungName
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, Reason
from tests.planning.behave.journey.bench import DRIVE, SIDE_M, Bench, room


def bench_of(world, grid, start, *ladder, **recovery):
    config = RecoveryConfig(wait_s=0.0, ladder=ladder, **recovery)
    return Bench(world, grid, start=start, config=NavigationConfig(recovery=config))


def bent_corridor(*, closed):
    """Return a corridor 1 m wide: 5 m to the right, then 5 m up, where it may be closed."""
    cells = np.full((130, 130), 100, np.int8)
    cells[2:22, 2:128] = cells[2:128, 108:128] = 0
    if closed:
        cells[100:104, 108:128] = 100
    return cells


def test_every_rung_that_a_file_may_name_exists():
    assert set(RUNGS) == set(get_args(RungName))
    assert len({rung.words for rung in RUNGS.values()}) == len(RUNGS)


def test_the_order_is_that_of_the_file():
    ladder = Ladder(RecoveryConfig(ladder=("ask", "wait", "ask")), can_turn=True)
    assert list(iter(ladder.climb, None)) == ["ask", "wait", "ask"]
    assert Ladder(RecoveryConfig(ladder=()), can_turn=True).climb() is None


def test_a_rung_that_does_not_exist_is_named_with_the_nearest_one():
    text = 'name = "m"\nstart = { x_m = 1.0, y_m = 1.0 }\n[recovery]\nladder = ["retrase"]\n'
    item = '[[item]]\nkind = "goto"\nx_m = 4.0\ny_m = 1.0\n'
    with pytest.raises(ConfigError, match=r"m\.toml:4: .*ladder.*retrase.*retrace"):
        parse_mission(text + item, "m.toml")


def test_it_drives_back_round_the_bend_by_which_it_came():
    start = SE2(0.6, 0.6, 0.0)
    bench = bench_of(
        bent_corridor(closed=True),
        bent_corridor(closed=False),
        start,
        "retrace",
        retrace_m=6.0,
        retries=1,
    )
    came, back = [], []

    def note(each):
        place = each.pose.x_m, each.pose.y_m
        (back if each.texts and each.texts[-1].startswith(Retrace.words) else came).append(place)

    end = bench.drive(5.9, 6.0, seconds=200.0, each=note)
    assert end.status is Status.FAILED
    assert "retrace" not in end.text
    assert max(y for _, y in came) > 3.5
    lowest = min(back, key=lambda place: place[0] + place[1])
    assert lowest[1] < 1.0, "it is in the first half of the corridor again"
    off_m = [min(math.dist(each, place) for place in came) for each in back]
    assert max(off_m) < 0.12


def test_it_ends_at_once_where_nothing_was_driven_ahead():
    world = room()
    bench = bench_of(world, world, SE2(1.0, 2.0, 0.0), "retrace")
    bench.move = lambda v, omega: setattr(bench, "now_ns", bench.now_ns + 50_000_000)
    end = bench.drive(5.0, 2.0, seconds=30.0)
    assert end.status is Status.FAILED
    assert sum(text.startswith(Retrace.words) for text in bench.texts) <= 4


def two_doors():
    cells = room()
    cells[:, 60] = 100
    cells[30:46, 60] = cells[62:78, 60] = 0
    return cells


def held_before_the_near_door(bench):
    """Let nobody get through the near door, as where a sonar hears what no map shows."""
    drive = bench.move

    def move(v, omega):
        if 2.4 < bench.pose.x_m < 3.4 and bench.pose.y_m < 2.6:
            v = min(v, 0.0) if math.cos(bench.pose.theta_rad) > 0.2 else v
        drive(v, omega)

    bench.move = move
    return bench


@pytest.mark.parametrize(("rung", "times"), [("other_way", 1), ("replan", 3)])
def test_it_takes_another_way_where_it_is_held_and_nothing_is_seen(rung, times):
    start = SE2(1.0, 1.9, 0.0)
    bench = held_before_the_near_door(
        bench_of(two_doors(), two_doors(), start, *[rung] * 5, retries=10)
    )
    assert bench.drive(5.0, 1.9, seconds=90.0).status is Status.DONE
    told = [text.startswith(RUNGS[rung].words) for text in bench.texts]
    assert np.count_nonzero(np.diff([0, *told]) == 1) == times


def test_where_it_was_in_trouble_once_it_may_go_again():
    bench = held_before_the_near_door(
        bench_of(two_doors(), two_doors(), SE2(1.0, 1.9, 0.0), "replan", retries=1)
    )
    assert bench.drive(5.0, 1.9, seconds=90.0).status is Status.FAILED
    plan = bench.pilot.tools.paths.plan(SE2(1.0, 1.9, 0.0), Goal(5.0, 1.9))
    assert plan.poses[:, 1].max() < 2.6  # by the near door


def test_a_journey_avoids_nothing_that_the_one_before_did():
    bench = held_before_the_near_door(
        bench_of(two_doors(), two_doors(), SE2(1.0, 1.9, 0.0), "other_way", retries=10)
    )
    assert bench.drive(5.0, 1.9, seconds=90.0).status is Status.DONE
    paths = bench.pilot.tools.paths
    around = paths.plan(SE2(1.0, 1.9, 0.0), Goal(5.0, 1.9))
    bench.pilot.journey(Goal(1.0, 1.9), 0.5)
    assert paths.plan(SE2(1.0, 1.9, 0.0), Goal(5.0, 1.9)).length_m < around.length_m - 0.5


def asked(answer_s=math.inf, opens_s=math.inf):
    """Drive to a place behind what closes the way, until an end or 20 s after it first asks.

    Returns
    -------
    end, asked_s
        The end, None: there was none yet, and how often it asked, each time for how long [s].
    """
    world = room()
    world[:, 60:62] = 100
    bench = bench_of(world, room(), SE2(1.0, 2.0, 0.0), "ask", ask_s=5.0, retries=1)
    journey = bench.pilot.journey(Goal(5.0, 2.0), 0.8)
    begun_ns, asked_s, answered = None, [], False
    asks = False
    while begun_ns is None or bench.now_ns - begun_ns < 20e9:
        since_s = 0.0 if begun_ns is None else (bench.now_ns - begun_ns) * 1e-9
        if since_s > opens_s:
            bench.world = room()
        bench.look()
        answers = since_s > answer_s and not answered
        answered |= answers
        situation = BehaviourInput(bench.pose, bench.twist, (), (), go_ahead=answers)
        step = journey.step(situation, bench.now_ns)
        if step.asks:
            begun_ns = begun_ns or bench.now_ns
            asked_s += [] if asks else [0.0]
            asked_s[-1] += 0.05
            assert step.text.startswith(Ask.words)
            assert "no map shows" in step.text
        asks = step.asks
        if step.status is not Status.RUNNING:
            return step, asked_s
        bench.move(step.v_m_s, step.omega_rad_s)
    return None, asked_s


def test_without_an_answer_it_gives_up():
    end, asked_s = asked()
    assert end.status is Status.FAILED
    assert end.text.startswith("gave up after ")
    assert "something" in end.text
    assert asked_s == [pytest.approx(5.0, abs=0.15)]


def test_with_an_answer_it_tries_all_again():
    end, asked_s = asked(answer_s=2.0)
    assert end.status is Status.FAILED
    assert asked_s == [pytest.approx(2.0 + 5.0, abs=0.15)]


def test_it_does_not_ask_on_when_the_way_opens():
    end, asked_s = asked(opens_s=1.0)
    assert end.status is Status.DONE
    assert asked_s == [pytest.approx(1.5, abs=0.6)]


def test_a_mission_waits_for_the_go_ahead_while_its_item_asks():
    world = room()
    world[:, 60:62] = 100
    bench = bench_of(world, room(), SE2(1.0, 2.0, 0.0), "ask")
    config = NavigationConfig()
    guard = ObstacleGuard(config.guard, ())
    crumbs = Breadcrumbs(SE2(), steered=False)
    robot = NavigatedRobot(config, DRIVE, (), guard, crumbs, pilot=bench.pilot)
    text = 'name = "m"\nstart = { x_m = 1.0, y_m = 2.0 }\n'
    item = '[[item]]\nkind = "goto"\nx_m = 5.0\ny_m = 2.0\n'
    runner = MissionRunner(parse_mission(text + item, "m.toml"), robot)
    runner.begin()
    for _ in range(400):
        bench.look()
        step = runner.step(BehaviourInput(bench.pose, bench.twist, (), ()), bench.now_ns)
        assert runner.waits == step.asks
        if step.asks:
            break
        bench.move(step.v_m_s, step.omega_rad_s)
    assert runner.waits
    assert abs(bench.pose.x_m - 60 * SIDE_M) < 1.2
    runner.pause()
    assert not runner.waits
    runner.step(BehaviourInput(bench.pose, bench.twist, (), ()), bench.now_ns)
    runner.jump(1)
    assert not runner.waits


class Slow:
    """A planner that has not enough time where a place is closed."""

    def __init__(self, place):
        self.place, self.closed = place, 0

    def plan(self, space, start, goal, goes_on):
        row, column = space.grid.cell_of(np.array([self.place]))[0]
        if space.blocked[row, column]:
            self.closed += 1
            return PlanFailure(Reason.OUT_OF_TIME, "the time was over")
        ends = [(each.x_m, each.y_m, each.theta_rad) for each in (start, goal)]
        return Plan(np.array(ends), 1.0, 1)


def test_a_place_is_avoided_no_more_if_a_way_round_takes_too_long_to_find():
    bench = Bench(room(), room(), SE2(1.0, 2.0, 0.0))
    bench.look()
    paths = bench.pilot.tools.paths
    paths.planner = Slow((3.0, 2.0))
    paths.avoid((3.0, 2.0))
    for _ in range(3):
        assert isinstance(paths.plan(bench.pose, Goal(5.0, 2.0)), Plan)
    assert paths.planner.closed == 1
