"""Somebody comes along a corridor in which there is no room to pass."""

import math

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.journey.give_way import GiveWay, meeting
from robotctl.planning.config import JourneyConfig, NavigationConfig, PeopleConfig
from robotctl.planning.map.lane import Lane
from tests.planning.behave.journey.bench import BODY, SIDE_M, Bench

PERSON_M = 0.22
BEAMS = np.linspace(-math.pi, math.pi, 360, endpoint=False)


def corridor():
    """Return two halls with a corridor of 1 m between x = 5 and 11, about y = 2."""
    cells = np.zeros((80, 280), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[:30, 100:220] = cells[50:, 100:220] = 100
    return cells


def with_person(cells, x_m, y_m):
    """Return the cells of a world with somebody in it."""
    rows, columns = np.indices(cells.shape)
    there = np.hypot((columns + 0.5) * SIDE_M - x_m, (rows + 0.5) * SIDE_M - y_m) <= PERSON_M
    return np.where(there, 100, cells).astype(np.int8)


def gap_m(pose, x_m, y_m):
    """Return the gap between the robot and somebody, about right near corners [m]."""
    local = pose.inverse() @ SE2(x_m, y_m, 0.0)
    return -BODY.depth_m(local.x_m, local.y_m) - PERSON_M


class Walk:
    """Somebody who walks straight along the corridor and looks at nothing; keeps the least gap."""

    def __init__(self, x_m, y_m, speed_m_s):
        self.x_m, self.y_m, self.speed_m_s = x_m, y_m, speed_m_s
        self.empty = corridor()
        self.least_m = math.inf

    def __call__(self, bench):
        x_m = self.x_m + self.speed_m_s * bench.now_ns * 1e-9
        is_there = 0.3 < x_m < 13.7
        bench.world = with_person(self.empty, x_m, self.y_m) if is_there else self.empty
        if is_there:
            self.least_m = min(self.least_m, gap_m(bench.pose, x_m, self.y_m))


def drive(walk, start, config=None):
    bench = Bench(corridor(), corridor(), start=start, config=config, beams=BEAMS)
    return bench, bench.drive(13.0, 2.0, seconds=90.0, speed_m_s=0.4, each=walk)


@pytest.mark.parametrize(("begins_m", "beside_m"), [(12.0, -0.08), (13.0, 0.05), (15.0, 0.0)])
def test_who_comes_head_on_and_cannot_be_passed_is_given_way_to(begins_m, beside_m):
    walk = Walk(begins_m, 2.0 + beside_m, -0.7)
    bench, end = drive(walk, SE2(4.0, 2.0, 0.0))
    assert end.status is Status.DONE
    assert walk.least_m > 0.05
    assert GiveWay.text in bench.texts


def test_one_that_gives_way_to_nobody_stands_in_the_corridor():
    walk = Walk(13.0, 2.0, -0.7)
    config = NavigationConfig(journey=JourneyConfig(people=PeopleConfig(give_way_s=0.0)))
    with pytest.raises(AssertionError, match="SE2"):  # the bench finds them in one place
        drive(walk, SE2(4.0, 2.0, 0.0), config)
    assert walk.least_m < 0.0  # the same person, so the tests above can fail


def test_who_comes_from_behind_is_let_pass():
    walk = Walk(0.4, 2.0, 0.6)
    _, end = drive(walk, SE2(2.6, 2.0, 0.0))
    assert end.status is Status.DONE
    assert walk.least_m > 0.05


class Heard(Walk):
    """The same, but the robot only hears how far away they are, up to 4 m on its line."""

    def __call__(self, bench):
        x_m = self.x_m + self.speed_m_s * bench.now_ns * 1e-9
        self.least_m = min(self.least_m, gap_m(bench.pose, x_m, self.y_m))
        away = bench.pose.inverse() @ SE2(x_m, self.y_m, 0.0)
        is_heard = abs(away.x_m) < 4.0 and abs(math.atan2(away.y_m, abs(away.x_m))) < 0.2
        c, s = math.cos(bench.pose.theta_rad), math.sin(bench.pose.theta_rad)
        nears_m_s = math.copysign(self.speed_m_s * c, -away.x_m * self.speed_m_s * c)
        row = [
            bench.pose.x_m + away.x_m * c, bench.pose.y_m + away.x_m * s,
            abs(nears_m_s) * -math.copysign(c, away.x_m),
            abs(nears_m_s) * -math.copysign(s, away.x_m), 0.25,
        ]  # fmt: skip
        comes = away.x_m * self.speed_m_s * c < 0.0
        bench.pilot.tools.world.heard = np.array([row] if is_heard and comes else []).reshape(-1, 5)


@pytest.mark.parametrize("beside_m", [-0.15, 0.0, 0.15])
@pytest.mark.parametrize(("begins_m", "speed_m_s", "start_m"), [(13.0, -0.5, 4.0), (0.4, 0.6, 2.6)])
def test_who_is_only_heard_is_given_way_to_out_of_the_corridor(
    begins_m, speed_m_s, start_m, beside_m
):
    walk = Heard(begins_m, 2.0 + beside_m, speed_m_s)
    bench, end = drive(walk, SE2(start_m, 2.0, 0.0))
    assert GiveWay.text in bench.texts
    assert end.status is Status.DONE
    assert walk.least_m > 0.03
    config = NavigationConfig(journey=JourneyConfig(people=PeopleConfig(give_way_s=0.0)))
    walk = Heard(begins_m, 2.0 + beside_m, speed_m_s)
    drive(walk, SE2(start_m, 2.0, 0.0), config)
    assert walk.least_m < 0.0  # so the test can fail


PATH = np.column_stack([np.linspace(0.0, 8.0, 161), np.zeros(161), np.zeros(161)])


@pytest.mark.parametrize(
    ("moving", "met_m"),
    [
        ((6.0, 0.0, -0.8, 0.0, 0.2), 2.0),  # 6 m apart, nearing by 1.2 m/s
        ((-2.0, 0.0, 0.8, 0.0, 0.2), 2.0),  # behind, faster by 0.4 m/s
        ((-2.0, 0.0, 0.3, 0.0, 0.2), None),  # behind, slower
        ((2.0, 0.0, 0.3, 0.0, 0.2), None),  # ahead, walks away
        ((2.0, -4.0, 0.0, 0.8, 0.2), None),  # crosses
        ((6.0, 1.0, -0.8, 0.0, 0.2), None),  # comes along beside
    ],
)
def test_a_meeting_is_expected_where_both_will_be(moving, met_m):
    lane = Lane.of(np.array(moving))
    met = meeting(lane, SE2(), PATH, 0.4, near_m=0.45, ahead_s=10.0)
    if met_m is None:
        assert met is None
    else:
        closing = abs(moving[2] - 0.4)
        assert abs(met.x_m - (met_m - 0.4 * 0.45 / closing)) < 0.06
