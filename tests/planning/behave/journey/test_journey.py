"""Journeys through rooms whose passages are known, with what no map tells of."""

import math

import numpy as np
import pytest

from robotctl.errors import InvalidValue
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.behaviours.recovery import Ladder
from robotctl.planning.behave.journey.rungs import RUNGS, Wait
from robotctl.planning.config import JourneyConfig, NavigationConfig, PilotConfig, RecoveryConfig
from robotctl.planning.map.seen import Seen
from robotctl.planning.map.zone import Zone
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, Reason
from robotctl.planning.path.local.controller import LocalMotion
from tests.planning.behave.journey.bench import BODY, SIDE_M, Bench, room, two_rooms


def test_it_arrives_through_a_door_with_the_heading_that_was_asked_for():
    bench = Bench(two_rooms(0.8), two_rooms(0.8))
    end = bench.drive(5.0, 3.0, math.pi / 2)
    assert end.status is Status.DONE
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (5.0, 3.0)) < 0.06
    assert abs(wrap_angle(bench.pose.theta_rad - math.pi / 2)) < 0.09
    best_s = (2.0 + math.sqrt(5.0)) / 0.8
    assert bench.now_ns * 1e-9 < 1.6 * best_s + 2.0
    assert bench.pilot.recoveries == 0


def test_a_box_that_no_map_tells_of_is_passed():
    world = room()
    world[28:52, 55:63] = 100
    bench = Bench(world, room())
    assert bench.drive(5.0, 2.0).status is Status.DONE


def test_without_a_map_it_finds_its_way_round_a_wall():
    world = room()
    world[10:80, 60] = 100
    bench = Bench(world)
    assert bench.drive(5.0, 3.0).status is Status.DONE


def test_a_goal_far_beyond_what_is_known_is_driven_to_by_stages():
    bench = Bench(room(32.0, 4.0))
    end = bench.drive(31.0, 2.0, seconds=60.0)
    assert end.status is Status.DONE
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (31.0, 2.0)) < 0.06


def test_the_map_stays_small_however_far_the_goal_and_a_stage_has_room():
    pit = Zone("pit", ((24.0, 1.0), (28.0, 1.0), (28.0, 3.0), (24.0, 3.0)))
    config = NavigationConfig(pilot=PilotConfig(zone=(pit,)))
    bench = Bench(room(44.0, 4.0), config=config)
    bench.look()
    plan = bench.pilot.tools.paths.plan(bench.pose, Goal(4000.0, 2.0))
    assert isinstance(plan, Plan)
    end = plan.poses[-1]
    assert 1.0 + BODY.inscribed_m < abs(end[1] - 2.0) < 1.5  # beside the pit
    assert abs(end[0] - 26.0) < 0.5
    assert max(bench.pilot.tools.world.map.space().shape) * SIDE_M < 70.0


def test_what_the_map_itself_forbids_is_said_at_once():
    bench = Bench(two_rooms(0.2), two_rooms(0.2))
    end = bench.drive(5.0, 2.0)
    assert end.status is Status.FAILED
    assert bench.now_ns == 0
    assert "0.20 m wide" in end.text
    assert "0.10 m are missing" in end.text


def test_a_closed_door_is_waited_for_and_every_rung_is_tried_before_it_gives_up():
    bench = Bench(two_rooms(0.0), two_rooms(0.8))
    end = bench.drive(5.0, 2.0, seconds=120.0)
    assert end.status is Status.FAILED
    assert end.text.startswith("gave up after ")
    assert "that no map shows closes the way at x 3.0" in end.text
    ladder = RecoveryConfig().ladder
    for rung in ladder:
        assert any(text.startswith(RUNGS[rung].words) for text in bench.texts), rung
    assert bench.pilot.recoveries >= len(ladder)


def test_a_door_that_opens_meanwhile_is_driven_through():
    bench = Bench(two_rooms(0.0), two_rooms(0.8))

    def opens(bench):
        if bench.now_ns > 6_000_000_000:
            bench.world = two_rooms(0.8)

    assert bench.drive(5.0, 2.0, seconds=90.0, each=opens).status is Status.DONE
    assert bench.pilot.recoveries >= 1


def test_without_scans_it_stands_and_with_new_ones_it_drives_on():
    bench = Bench(room(), room())

    def blinks(bench):
        bench.sees = not 1_500_000_000 < bench.now_ns < 5_000_000_000
        if 2_600_000_000 < bench.now_ns < 5_000_000_000:
            assert bench.twist.v_m_s == 0.0
            assert bench.texts[-1] == "waiting: the lidar gives no scans"

    assert bench.drive(5.0, 2.0, each=blinks).status is Status.DONE


@pytest.mark.parametrize("longest_s", [10.0, 4.0])
def test_a_robot_that_stays_blind_gives_up(longest_s):
    config = NavigationConfig(journey=JourneyConfig(blind_max_s=longest_s))
    bench = Bench(room(), room(), config=config)
    bench.sees = False
    end = bench.drive(5.0, 2.0)
    assert end.text == f"the lidar gives no scans for {longest_s:g} s"
    assert longest_s - 1.0 < bench.now_ns * 1e-9 < longest_s + 1.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("replan_s", 0.0),
        ("stuck_s", math.nan),
        ("patience_s", 86_401.0),
        ("blind_max_s", -1.0),
        ("off_path_m", math.inf),
        ("better", 1.1),
        ("turning_reserve", 0.9),
    ],
)
def test_settings_of_journeys_out_of_range_are_refused_by_name(key, value):
    with pytest.raises(InvalidValue, match=rf"{key}.*found, .*allowed"):
        JourneyConfig(**{key: value})


def test_nothing_is_driven_backwards_where_no_sensor_has_seen_the_floor():
    """The goal is behind a robot in a passage too narrow to turn, whose lidar looks ahead only."""
    world = np.full((80, 120), 100, np.int8)
    world[36:44, 10:110] = 0
    ahead = np.linspace(-2.0, 2.0, 120)
    bench = Bench(world, start=SE2(4.0, 2.0, 0.0), beams=ahead)
    known = np.zeros(world.shape, bool)

    def looks(bench):
        space = bench.pilot.tools.world.map.space()
        rows, columns = np.nonzero(world == 0)
        places = np.column_stack([columns + 0.5, rows + 0.5]) * SIDE_M
        known[rows, columns] = space.grid.cells[tuple(space.grid.cell_of(places).T)] == 0
        if bench.twist.v_m_s < -0.01:
            behind = bench.pose.apply(-0.16, 0.0)
            assert known[int(behind[1] / SIDE_M), int(behind[0] / SIDE_M)]

    end = bench.drive(1.0, 2.0, seconds=60.0, each=looks)
    assert end.status is Status.FAILED
    assert bench.pose.x_m > 3.9


def test_the_time_for_planning_is_that_of_a_step_and_its_end_is_no_reason_to_give_up_for_good():
    steps = []

    def budget():
        steps.append(0)
        late = len(steps) < 20
        return lambda: not late

    world = np.zeros((700, 700), np.int8)
    world[:650, 350] = 100
    bench = Bench(world, world, budget=budget)
    end = bench.drive(30.0, 5.0, seconds=6.0)
    assert end is None
    assert any(text.startswith(f"{Wait.words}: the time was over") for text in bench.texts)
    assert bench.texts[-1].endswith("m to go")


def test_a_robot_whose_nose_is_in_a_wall_by_its_map_drives_out_of_there():
    """By 15 mm, as a localiser errs: that is no reason against the goal."""
    cells = room()
    bench = Bench(cells, cells, start=SE2(2.0, 0.235, -math.pi / 2))
    bench.move = lambda v, omega: Bench.move(bench, v, omega, checked=False)
    assert bench.drive(5.0, 2.0).status is Status.DONE


def test_a_planner_that_there_is_not_is_refused_with_those_that_there_are():
    config = NavigationConfig(pilot=PilotConfig(planner="astra"))
    with pytest.raises(ValueError, match="astra found; allowed are astar, dijkstra, hybrid"):
        Bench(room(), room(), config=config)


def test_a_ladder_goes_up_without_progress_and_begins_anew_with_it():
    ladder = Ladder(can_turn=True)
    assert tuple(iter(ladder.climb, None)) == RecoveryConfig().ladder
    ladder = Ladder(can_turn=False)
    climbs = []
    while (rung := ladder.climb()) is not None:
        climbs.append(rung)
        ladder.progress()
    assert set(climbs) == {"wait"}
    assert len(climbs) == ladder.tries <= 10
    assert "look_around" not in list(iter(Ladder(can_turn=False).climb, None))


@pytest.mark.parametrize(
    ("config", "away_m", "patient_s"),
    [
        (JourneyConfig(), 1.0, 6.0),
        (JourneyConfig(), 3.0, 1.5),
        (JourneyConfig(stuck_s=3.0, patience_s=2.0), 1.0, 2.0),
        (JourneyConfig(stuck_s=3.0, patience_s=2.0), 3.0, 3.0),
    ],
)
def test_a_robot_that_stands_is_in_trouble_later_where_somebody_is_near(config, away_m, patient_s):
    bench = Bench(room(), room(), config=NavigationConfig(journey=config))
    nothing = LocalMotion(0.0, 0.0, np.empty((0, 3)), text="waits for somebody to pass")
    bench.pilot.tools.controller.step = lambda _: nothing
    began = []

    def watches(bench):
        bench.pilot.tools.world.moving = np.array([[bench.pose.x_m + away_m, 2.0, 0.0, 0.5, 0.2]])
        if bench.pilot.recoveries and not began:
            began.append(bench.now_ns * 1e-9)

    bench.drive(5.0, 2.0, seconds=8.0, each=watches)
    assert began[0] == pytest.approx(patient_s, abs=0.15)


def test_no_path_is_no_trouble_yet_while_somebody_is_near():
    bench, began = Bench(room(), room()), []
    bench.pilot.tools.paths.plan = lambda *_: PlanFailure(
        Reason.NO_PASSAGE, "somebody is in the way"
    )

    def watches(bench):
        bench.pilot.tools.world.moving = np.array([[bench.pose.x_m + 1.0, 2.0, 0.0, 0.5, 0.2]])
        if bench.pilot.recoveries and not began:
            began.append(bench.now_ns * 1e-9)

    bench.drive(5.0, 2.0, seconds=8.0, each=watches)
    assert 6.0 <= began[0] <= 6.8


@pytest.mark.parametrize(("people_s", "arrives"), [(60.0, True), (0.0, False)])
def test_while_somebody_may_be_what_is_in_the_way_it_does_not_give_up(people_s, arrives):
    """Somebody stands in a door, leaves the robot's side at 60 s, and the door at 65 s."""
    recovery = RecoveryConfig(people_s=people_s, wait_s=2.0, ladder=("wait",))
    config = NavigationConfig(recovery=recovery)
    bench = Bench(two_rooms(0.0), two_rooms(0.8), config=config)

    def watches(bench):
        near = [[bench.pose.x_m + 1.0, 2.0, 0.0, 0.5, 0.2]] if bench.now_ns < 60e9 else []
        bench.pilot.tools.world.moving = np.array(near).reshape(-1, 5)
        if bench.now_ns > 65e9:
            bench.world = two_rooms(0.8)

    end = bench.drive(5.0, 2.0, seconds=120.0, each=watches)
    assert end.status is (Status.DONE if arrives else Status.FAILED)
    assert arrives or bench.now_ns < 65e9


def test_however_long_somebody_stays_it_gives_up_in_the_end():
    recovery = RecoveryConfig(people_s=40.0, wait_s=2.0, ladder=("wait",))
    config = NavigationConfig(recovery=recovery)
    ends_s = []
    for somebody in (False, True):
        bench = Bench(two_rooms(0.0), two_rooms(0.8), config=config)

        def watches(bench, somebody=somebody):
            if somebody:
                near = [[bench.pose.x_m + 1.0, 2.0, 0.0, 0.5, 0.2]]
                bench.pilot.tools.world.moving = np.array(near)

        end = bench.drive(5.0, 2.0, seconds=200.0, each=watches)
        assert end.status is Status.FAILED
        assert end.text.startswith("gave up after ")
        ends_s.append(bench.now_ns * 1e-9)
    alone_s, with_somebody_s = ends_s
    assert alone_s + 40.0 < with_somebody_s < alone_s + 40.0 + 30.0


def test_people_can_see_what_it_drives_by_while_it_drives():
    world = room()
    world[28:52, 55:63] = 100
    bench = Bench(world, room())
    seen = []
    move = bench.move

    def look_and_move(v, omega):
        if len((outlook := bench.pilot.outlook()).path):
            seen.append((bench.pose, outlook))
        move(v, omega)

    bench.move = look_and_move
    assert bench.drive(5.0, 2.0).status is Status.DONE
    for pose, outlook in seen[:: len(seen) // 8]:
        assert math.dist(outlook.path[0, :2], (pose.x_m, pose.y_m)) < 0.4  # else it plans anew
        assert math.dist(outlook.path[-1, :2], (5.0, 2.0)) < 0.06
        assert math.dist(outlook.arc[0, :2], (pose.x_m, pose.y_m)) < 0.15  # a step on
    # The box, which is on no map; its front is two metres ahead of the start.
    _, outlook = seen[20]
    assert np.abs(outlook.obstacles[:, 0].min() - 2.75) < 0.06
    assert set(outlook.costs.cells.ravel().tolist()) >= {0, 100}
    bench.pilot.see(bench.pose, Seen(), bench.now_ns + 1)
    assert len(bench.pilot.outlook().path) == 0
