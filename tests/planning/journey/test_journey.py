"""Journeys through rooms whose passages are known, with what no map tells of."""

import math

import pytest

from robotctl.model.geometry.angles import wrap_angle
from robotctl.planning.config import NavigationConfig, PilotConfig
from robotctl.planning.guard.behaviour import Status
from robotctl.planning.journey.recovery import LADDER, Ladder, Rung
from tests.planning.journey.bench import Bench, room, two_rooms


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
    assert "closed all around" in end.text or "no passage is wide enough" in end.text
    for rung in LADDER:
        assert any(text.startswith(rung.value) for text in bench.texts), rung
    assert bench.pilot.recoveries >= len(LADDER)


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


def test_a_planner_that_there_is_not_is_refused_with_those_that_there_are():
    config = NavigationConfig(pilot=PilotConfig(planner="astra"))
    with pytest.raises(ValueError, match="astra found; allowed are astar, dijkstra, hybrid"):
        Bench(room(), room(), config=config)


def test_a_ladder_goes_up_without_progress_and_begins_anew_with_it():
    ladder = Ladder(can_turn=True)
    assert [ladder.climb() for _ in LADDER] == list(LADDER)
    assert ladder.climb() is None
    ladder = Ladder(can_turn=False)
    climbs = []
    while (rung := ladder.climb()) is not None:
        climbs.append(rung)
        ladder.progress()
    assert set(climbs) == {Rung.WAIT}
    assert len(climbs) == ladder.tries <= 10
    assert Rung.LOOK_AROUND not in [Ladder(can_turn=False).climb() for _ in LADDER]
