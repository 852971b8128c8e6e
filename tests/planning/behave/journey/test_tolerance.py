"""Places that are reached within a tolerance of their own, and places on which something stands."""

import math

import pytest

from robotctl.errors import ConfigError
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.mission.mission_file import parse_mission
from tests.planning.behave.journey.bench import BODY, SIDE_M, Bench, room

GOAL = (4.5, 2.0)


def away_m(bench):
    return math.dist((bench.pose.x_m, bench.pose.y_m), GOAL)


@pytest.mark.parametrize("heading_rad", [None, 0.0])
@pytest.mark.parametrize("tolerance_m", [0.2, 0.6])
def test_it_is_there_within_the_tolerance(heading_rad, tolerance_m):
    bench = Bench(room(), room())
    assert bench.drive(*GOAL, heading_rad, tolerance_m).status is Status.DONE
    assert tolerance_m - 0.1 < away_m(bench) <= tolerance_m


def test_a_heading_that_was_asked_for_is_still_turned_to():
    bench = Bench(room(), room())
    assert bench.drive(*GOAL, math.pi / 2, 0.6).status is Status.DONE
    assert bench.pose.theta_rad == pytest.approx(math.pi / 2, abs=0.1)


def with_box(side_m):
    cells = room()
    half = round(0.5 * side_m / SIDE_M)
    x, y = (round(each / SIDE_M) for each in GOAL)
    cells[y - half : y + half, x - half : x + half] = 100
    return cells


def test_it_drives_beside_what_stands_on_the_place():
    bench = Bench(with_box(0.4), room())
    end = bench.drive(*GOAL, None, 1.0)
    assert end.status is Status.DONE
    assert 0.2 < away_m(bench) <= 1.0
    assert bench.pilot.recoveries == 0


@pytest.mark.parametrize("tolerance_m", [None, 0.3])
def test_it_does_not_where_that_is_too_far_from_it(tolerance_m):
    bench = Bench(with_box(0.4), room())
    end = bench.drive(*GOAL, None, tolerance_m, seconds=120.0)
    assert end is None or end.status is Status.FAILED
    assert away_m(bench) > 0.2 + min(x for x, _ in BODY.corners)


@pytest.mark.parametrize("value", [0.0, -1.0, 10.1])
def test_tolerances_out_of_range_are_refused_by_name(value):
    text = 'name = "m"\nstart = { x_m = 1.0, y_m = 1.0 }\n'
    item = f'[[item]]\nkind = "goto"\nx_m = 4.0\ny_m = 1.0\ntolerance_m = {value}\n'
    with pytest.raises(ConfigError, match=r"m\.toml:7: .*tolerance_m.*above 0 and at most 10"):
        parse_mission(text + item, "m.toml")
