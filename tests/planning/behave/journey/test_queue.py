"""Paths lead round people who have come and stand in line, and through doors without a stop."""

import math

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.journey.places_aside import PlacesAside
from robotctl.planning.config import JourneyConfig, NavigationConfig
from robotctl.planning.journey_config import PeopleConfig
from robotctl.planning.map.lane import Lane
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.local.controller import LocalMotion
from tests.planning.behave.journey.bench import SIDE_M, Bench, room, two_rooms

BEAMS = np.linspace(-math.pi, math.pi, 720, endpoint=False)
LINE_X_M = 6.0
LINE_Y_M = (1.0, 2.3, 3.6, 4.9)
WALKS_S = 4.0
RADIUS_M = 0.2


def minding(**people):
    return NavigationConfig(journey=JourneyConfig(people=PeopleConfig(**people)))


def with_people(places):
    """Return a room of 12 by 9 m where people stand."""
    cells = room(12.0, 9.0)
    rows, columns = np.mgrid[: cells.shape[0], : cells.shape[1]]
    for x_m, y_m in places:
        away_m = np.hypot((columns + 0.5) * SIDE_M - x_m, (rows + 0.5) * SIDE_M - y_m)
        cells[away_m <= RADIUS_M] = 100
    return cells


def lined_up(time_s):
    """Return where people are who walk up to a line, and stand there."""
    short_m = 0.8 * max(WALKS_S - time_s, 0.0)
    return [(LINE_X_M + short_m, y_m) for y_m in LINE_Y_M]


def beside_a_line(queue_m):
    """Return a robot that has seen people line up beside it, and where it drives then."""
    bench = Bench(room(12.0, 9.0), room(12.0, 9.0), SE2(2.0, 3.0), minding(queue_m=queue_m), BEAMS)
    while bench.now_ns < 1e9 * (WALKS_S + 1.5):
        bench.world = with_people(lined_up(1e-9 * bench.now_ns))
        bench.look()
        bench.move(0.0, 0.0)
    driven = []
    end = bench.drive(10.0, 3.0, each=lambda each: driven.append((each.pose.x_m, each.pose.y_m)))
    assert end.status is Status.DONE
    return np.array(driven)


def crossing_m(driven):
    """Return where a robot drove through the line that people stand on."""
    return float(np.interp(LINE_X_M, driven[:, 0], driven[:, 1]))


def test_it_goes_round_the_end_of_a_line():
    assert crossing_m(beside_a_line(1.5)) > max(LINE_Y_M) + RADIUS_M


@pytest.mark.parametrize("queue_m", [0.0, 1.0])
def test_between_people_who_stand_farther_apart_it_goes_through(queue_m):
    assert min(LINE_Y_M) < crossing_m(beside_a_line(queue_m)) < max(LINE_Y_M)


def test_who_was_never_seen_to_walk_may_be_a_post():
    world = with_people(lined_up(WALKS_S))
    bench = Bench(world, room(12.0, 9.0), SE2(2.0, 3.0), minding(queue_m=1.5), BEAMS)
    end = bench.drive(10.0, 3.0)
    assert end.status is Status.DONE
    assert not len(bench.pilot.tools.world.standing.places)


def test_a_line_that_forms_across_its_path_is_driven_round():
    bench = Bench(room(12.0, 9.0), room(12.0, 9.0), SE2(1.0, 3.0), minding(queue_m=1.5), BEAMS)
    driven = []

    def each(bench):
        bench.world = with_people(lined_up(1e-9 * bench.now_ns))
        driven.append((bench.pose.x_m, bench.pose.y_m))

    assert bench.drive(10.0, 3.0, speed_m_s=0.5, each=each).status is Status.DONE
    assert crossing_m(np.array(driven)) > max(LINE_Y_M) + RADIUS_M


def behind_the_door():
    """Return two rooms where something closes the way behind the door, at x = 3.8 m."""
    cells = two_rooms(0.8)
    cells[1:-1, 76:80] = 100
    return cells


@pytest.mark.parametrize(("door_m", "stands_m"), [(0.0, 3.1), (5.0, 2.25)])
def test_it_waits_before_a_door_not_in_it(door_m, stands_m):
    bench = Bench(behind_the_door(), two_rooms(0.8), SE2(1.0, 2.0), minding(door_m=door_m), BEAMS)
    bench.look()
    way = bench.pilot.tools.paths.closed_way(bench.pose, Goal(5.0, 2.0))
    assert way.plan.poses[-1, 0] == pytest.approx(stands_m, abs=0.1)


def corridor_with_a_side_door():
    """Return a corridor of 1.2 m, a room beside it behind a deep door of 0.8 m, and a niche."""
    cells = room(12.0, 5.0)
    cells[24:, :] = 100
    cells[24:40, 120:136] = 0  # the door, about x = 6.4 m, y = 1.2 to 2 m
    cells[40:98, 80:180] = 0
    cells[24:38, 150:170] = 0  # the niche, about x = 8 m
    return cells


@pytest.mark.parametrize(("door_m", "in_door"), [(0.0, True), (5.0, False)])
def test_it_waits_for_people_in_a_door_only_if_there_is_no_other_place(door_m, in_door):
    cells = corridor_with_a_side_door()
    pose = SE2(6.4, 0.65, 0.0)
    bench = Bench(cells, cells, pose, minding(door_m=door_m), BEAMS)
    bench.look()
    lane = Lane.of(np.array([0.6, 0.6, 0.5, 0.0, 0.22]))
    best = PlacesAside(bench.pilot.tools).find(lane, [lane], pose, 0.5, [])[0]
    assert (abs(best.x_m - 6.4) < 0.4 and 1.2 < best.y_m < 2.0) is in_door, best


def two_far_doors(person=None):
    """Return two rooms with a door of 0.8 m about (6, 1), where one may be, and one far off."""
    cells = with_people([] if person is None else [person])
    cells[:12, 120] = cells[28:150, 120] = cells[170:, 120] = 100
    return cells


@pytest.mark.parametrize(("stays_s", "by_the_door"), [(4.5, True), (60.0, False)])
def test_it_waits_for_somebody_in_a_door_before_it_takes_a_long_way_round(stays_s, by_the_door):
    bench = Bench(two_far_doors(), two_far_doors(), SE2(3.5, 1.0), minding(give_way_s=0.0), BEAMS)
    driven = []

    def each(bench):
        time_s = 1e-9 * bench.now_ns
        comes = max(8.0 - 0.8 * time_s, 6.0), 1.0
        bench.world = two_far_doors(comes if time_s < stays_s else None)
        driven.append((bench.pose.x_m, bench.pose.y_m))

    assert bench.drive(8.5, 1.0, seconds=90.0, each=each).status is Status.DONE
    assert "waiting before a detour" in bench.texts
    assert bool(crossing_m(np.array(driven)) < 3.0) is by_the_door


class Creeping:
    """A controller that creeps away from something."""

    def step(self, situation):
        ahead = np.array([[situation.pose.x_m, situation.pose.y_m, 0.0]])
        return LocalMotion(0.25, 0.1, ahead, text="creeps away", creeps=True)

    def reset(self):
        """Nothing is kept."""


@pytest.mark.parametrize(("paces_m", "creeps"), [(0.0, True), (0.4, False)])
def test_it_does_not_creep_past_somebody_who_is_there_just_now(paces_m, creeps):
    bench = Bench(room(12.0, 9.0), room(12.0, 9.0), SE2(3.0, 3.0), minding(give_way_s=0.0), BEAMS)
    bench.pilot.tools.controller = Creeping()
    journey = bench.pilot.journey(Goal(9.0, 3.0), 0.5)
    outputs = []
    while bench.now_ns < 1.4e9:  # then it has stood for too long
        bench.world = with_people([(3.8, 3.0 + paces_m * math.sin(2e-9 * bench.now_ns))])
        bench.look()
        situation = BehaviourInput(bench.pose, bench.twist, (), ())
        outputs.append(journey.step(situation, bench.now_ns))
        bench.move(0.0, 0.0)
    speeds = [output.v_m_s for output in outputs[20:28]]
    texts = {output.text for output in outputs[20:28]}
    assert all(speed == (0.25 if creeps else 0.0) for speed in speeds)
    assert ("waiting for somebody to step back" in texts) is not creeps
