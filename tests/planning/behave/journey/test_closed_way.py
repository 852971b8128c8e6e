"""Ways that something on no map closes: the free part is driven, and the rest once it opens."""

import math

import numpy as np
import pytest

from robotctl.errors import InvalidValue
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.behaviours.recovery import Ladder
from robotctl.planning.behave.journey.rungs import Wait
from robotctl.planning.behave.mission.mission_file import parse_mission
from robotctl.planning.config import NavigationConfig, RecoveryConfig
from robotctl.planning.path.global_planning.goal import Goal
from tests.planning.behave.journey.bench import BODY, SIDE_M, Bench, room, two_rooms

START = SE2(1.0, 0.6, 0.0)
GOAL = (11.0, 0.6)
AT_M = 8.0
"""Where something stands in the corridor: its near side."""


def corridor(*, closed=False):
    cells = room(12.0, 1.2)
    if closed:
        cells[7:17, round(AT_M / SIDE_M) : round(AT_M / SIDE_M) + 8] = 100
    return cells


def in_corridor(recovery=None):
    config = NavigationConfig(recovery=recovery or RecoveryConfig())
    return Bench(corridor(closed=True), corridor(), start=START, config=config)


def opens(at_s, world):
    def each(bench):
        if bench.now_ns > at_s * 1e9:
            bench.world = world

    return each


def test_it_waits_where_the_way_is_closed_and_drives_on_at_once_when_it_opens():
    bench = in_corridor()
    end = bench.drive(*GOAL, seconds=60.0, each=opens(25.0, corridor()))
    assert end.status is Status.DONE
    assert bench.now_ns * 1e-9 < 25.0 + (GOAL[0] - AT_M + 1.0) / 0.8 + 2.0
    waits = [text for text in bench.texts if text.startswith(Wait.words)]
    assert "something 0.5 m wide that no map shows closes the way at x 8.0" in waits[0]
    assert len(waits) > 200
    assert bench.pilot.recoveries == 1


def test_without_an_opening_it_gives_up_before_the_place_and_says_what_stands_there():
    bench = in_corridor(RecoveryConfig(wait_s=5.0, retries=0))
    end = bench.drive(*GOAL, seconds=60.0)
    assert end.status is Status.FAILED
    assert end.text.startswith("gave up after 1 try: something 0.5 m wide that no map shows")
    nose = max(x for x, _ in BODY.corners)
    assert 0.1 < AT_M - nose - bench.pose.x_m < 0.7
    drive_s = (AT_M - START.x_m) / 0.8
    assert drive_s + 5.0 < bench.now_ns * 1e-9 < drive_s + 5.0 + 3.0


@pytest.mark.parametrize("wait_s", [0.0, 12.0])
def test_how_long_it_waits_is_set(wait_s):
    bench = in_corridor(RecoveryConfig(wait_s, retries=0))
    bench.drive(*GOAL, seconds=60.0)
    waits = [text for text in bench.texts if text.startswith(Wait.words)]
    assert len(waits) * 0.05 == pytest.approx(wait_s, abs=0.2)


def test_a_mission_may_be_more_patient_than_the_robot():
    bench = in_corridor(RecoveryConfig(wait_s=1.0, retries=0))
    bench.pilot.use_recovery(RecoveryConfig(wait_s=90.0))
    assert bench.drive(*GOAL, seconds=80.0, each=opens(50.0, corridor())).status is Status.DONE
    bench.pilot.use_recovery(None)
    assert bench.pilot.tools.recovery == RecoveryConfig(wait_s=1.0, retries=0)


def test_a_shut_door_is_driven_up_to():
    bench = Bench(two_rooms(0.0), two_rooms(0.8))
    end = bench.drive(5.0, 2.0, seconds=60.0, each=opens(15.0, two_rooms(0.8)))
    assert end.status is Status.DONE
    assert any("closes the way at x 3.0" in text for text in bench.texts)


def test_what_stands_right_before_the_robot_is_waited_for_where_it_is():
    bench = Bench(corridor(), corridor(), start=SE2(AT_M - 0.5, 0.6, 0.0))
    bench.world = corridor(closed=True)
    end = bench.drive(*GOAL, seconds=60.0, each=opens(10.0, corridor()))
    assert end.status is Status.DONE
    assert any(text.startswith(Wait.words) for text in bench.texts)


def test_somebody_who_moves_is_called_that():
    bench = in_corridor(RecoveryConfig(wait_s=1.0, retries=0))
    bench.look()
    bench.pilot.tools.world.moving = np.array([[AT_M + 0.2, 0.6, 0.0, 0.3, 0.3]])
    way = bench.pilot.tools.paths.closed_way(bench.pose, Goal(*GOAL))
    assert way.text.startswith("somebody that no map shows closes the way at x 8.0")
    free_m = math.hypot(*(way.plan.poses[-1, :2] - (START.x_m, START.y_m)))
    assert free_m == pytest.approx(AT_M - 0.2 - 0.5 - START.x_m, abs=0.15)


def test_a_way_that_is_open_is_not_called_closed():
    bench = Bench(corridor(), corridor(), start=START)
    bench.look()
    assert bench.pilot.tools.paths.closed_way(bench.pose, Goal(*GOAL)) is None


@pytest.mark.parametrize(
    ("key", "value"),
    [("wait_s", -1.0), ("wait_s", math.nan), ("retries", -1), ("back_off_m", 5.1)],
)
def test_settings_out_of_range_are_refused_by_name(key, value):
    with pytest.raises(InvalidValue, match=rf"{key}.*found, 0 to"):
        RecoveryConfig(**{key: value})


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_it_begins_to_recover_as_often_as_is_set(retries):
    ladder = Ladder(RecoveryConfig(retries=retries), can_turn=True)
    begun = 0
    while ladder.climb() is not None:
        begun += 1
        ladder.progress()
    assert begun == retries


def test_a_robot_that_is_not_to_back_off_does_not():
    ladder = Ladder(RecoveryConfig(back_off_m=0.0), can_turn=False)
    rungs = list(iter(ladder.climb, None))
    assert rungs == ["wait", "replan", "clear", "other_way"]


def test_a_mission_file_sets_its_patience():
    text = (
        'name = "m"\nstart = { x_m = 1.0, y_m = 1.0 }\n[recovery]\nwait_s = 600.0\nretries = 2\n'
        '[[item]]\nkind = "goto"\nx_m = 4.0\ny_m = 1.0\n'
    )
    assert parse_mission(text, "m.toml").recovery == RecoveryConfig(600.0, 2)
