"""Places that are passed again fit where the map has them, or where they really are."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.verdict.map_check import breaks, contradicted_places, shifts_of
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, box, scan_of

ROUND = [(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0), (1.0, 1.0)]
ONCE, TWICE = along(ROUND), along(ROUND + ROUND[1:])
pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def made(shift, people=0):
    """Return a map of two rounds, the second one drawn elsewhere, past people who walk about."""
    rng = np.random.default_rng(4)
    growing = GrowingMap(KeyframeConfig(), [], BackEnd())
    for number, pose in enumerate(TWICE):
        places = rng.uniform((0.0, 0.0), (14.0, 10.0), (people, 2))
        apart = np.hypot(*(places - (pose.x_m, pose.y_m)).T) > 0.8
        crowd = [box(*place, 0.4, 0.3) for place in places[apart].tolist()]
        scan = scan_of(np.concatenate([OFFICE, *crowd]), pose, rng)
        growing.keyframes.append(Keyframe(scan, 0.3 * number))
        growing.back_end.add(pose if number < len(ONCE) else shift @ pose)
    return growing


@pytest.mark.parametrize("people", [0, 12])
def test_a_right_map_fits_where_it_is_with_people_in_it_too(people):
    growing = made(SE2(), people)
    fits = shifts_of(growing)
    assert len(fits) > 40
    assert sum(each > 0.0 for each in fits) <= 1
    assert breaks(growing) == []


@pytest.mark.parametrize("shift_m", [0.4, 0.9])
def test_a_doubled_map_fits_better_by_what_it_is_doubled(shift_m):
    fits = shifts_of(made(SE2(shift_m / np.sqrt(2.0), shift_m / np.sqrt(2.0))))
    shifts = [each for each in fits if each > 0.0]
    assert len(shifts) > 0.4 * len(fits)
    assert np.median(shifts) == pytest.approx(shift_m, abs=0.1)


def test_visits_of_a_doubled_map_contradict_each_other_and_people_do_not():
    off, places = contradicted_places(made(SE2(), people=4))
    assert places > 40
    assert off <= 0.06 * places
    off, places = contradicted_places(made(SE2(0.6, 0.6)))
    assert off > 0.5 * places > 10


def test_a_robot_that_was_carried_breaks_the_map_until_a_loop_joins_it():
    growing = made(SE2())
    del growing.keyframes[30:45]  # and the map goes on where it was: see what is taken for a motion
    kept = growing.back_end.poses[[*range(30), *range(45, len(TWICE))]]
    carried = SE2(*kept[29]) @ SE2(0.3, 0.0) @ SE2(*kept[30]).inverse()
    broken = GrowingMap(growing.config, growing.keyframes[:60], BackEnd())
    for number, row in enumerate(kept[:60].tolist()):
        broken.back_end.add(SE2(*row) if number < 30 else carried @ SE2(*row))
    assert breaks(broken) == [30]
    loop = KeyframeLink(20, 45, broken.back_end.between(20, 45), np.eye(3), is_loop=True)
    broken.back_end.link(loop)
    assert breaks(broken) == []
