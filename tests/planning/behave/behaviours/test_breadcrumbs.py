"""The way back: spacing, forgotten loops, gears."""

import itertools
import math

import pytest

from robotctl.model.drives.motion import arc
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs


def walk(crumbs, pose, distance, angle=0.0, step=0.02):
    n = max(1, round(abs(distance) / step))
    for _ in range(n):
        pose = arc(pose, distance / n, angle / n)
        crumbs.record(pose)
    return pose


def test_crumbs_lie_a_spacing_apart():
    crumbs = Breadcrumbs(SE2(), steered=False)
    walk(crumbs, SE2(), 2.0)
    points = crumbs.legs()[0].points
    gaps = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    assert sum(gaps) == pytest.approx(2.0, abs=0.13)
    assert all(0.1 - 1e-9 <= gap < 0.13 for gap in gaps)
    assert points[-1] == (0.0, 0.0)


def test_a_robot_that_has_not_moved_has_no_way_back():
    crumbs = Breadcrumbs(SE2(1.0, 1.0, 0.0), steered=False)
    crumbs.record(SE2(1.05, 1.0, 0.0))
    assert crumbs.legs() == []


@pytest.mark.parametrize("steered", [False, True])
def test_a_full_circle_is_forgotten(steered):
    crumbs = Breadcrumbs(SE2(), steered=steered)
    pose = walk(crumbs, SE2(), 1.0)
    before = len(crumbs)
    pose = walk(crumbs, pose, 2 * math.pi * 0.6, 2 * math.pi)
    assert len(crumbs) <= before + 2
    walk(crumbs, pose, 1.0)
    length = sum(len(leg.points) - 1 for leg in crumbs.legs()) * 0.1
    assert length == pytest.approx(2.0, abs=0.3)


def test_a_crossing_shortens_only_the_way_of_a_robot_that_turns_on_the_spot():
    lengths = {}
    for steered in (False, True):
        crumbs = Breadcrumbs(SE2(), steered=steered)
        pose = walk(crumbs, SE2(), 3.0)
        pose = walk(crumbs, pose, 1.5 * math.pi * 0.8, 1.5 * math.pi)  # back across its own way
        walk(crumbs, pose, 1.5)
        lengths[steered] = len(crumbs)
    assert lengths[False] < 0.6 * lengths[True]


def test_tracks_driven_backwards_are_left_forwards_and_the_other_way_round():
    crumbs = Breadcrumbs(SE2(), steered=True)
    pose = walk(crumbs, SE2(), 1.0)
    pose = arc(pose, -0.5, 0.9)
    crumbs.record(pose)
    pose = walk(crumbs, pose, -1.0)
    walk(crumbs, pose, 1.0, 1.0)
    assert [leg.reverse for leg in crumbs.legs()] == [True, False, True]
    ends = [(leg.points[0], leg.points[-1]) for leg in crumbs.legs()]
    assert ends[0][1] == ends[1][0]
    assert ends[1][1] == ends[2][0]
    assert ends[2][1] == (0.0, 0.0)


def test_a_differential_drive_returns_forwards_in_one_leg_whatever_it_did():
    crumbs = Breadcrumbs(SE2(), steered=False)
    pose = walk(crumbs, SE2(), 1.0)
    walk(crumbs, arc(pose, 0.0, 0.5), -1.0)
    assert [leg.reverse for leg in crumbs.legs()] == [False]


def test_home_is_never_dropped():
    crumbs = Breadcrumbs(SE2(), steered=False)
    walk(crumbs, SE2(), 1.0)
    crumbs.truncate(0)
    assert len(crumbs) == 1
    assert crumbs.legs() == []
    walk(crumbs, SE2(), 0.5)
    assert crumbs.legs()[0].points[-1] == (0.0, 0.0)


def test_memory_is_bounded_and_the_way_stays_whole():
    crumbs = Breadcrumbs(SE2(), steered=True, count_max=100)
    walk(crumbs, SE2(), 100.0, step=0.1)
    assert len(crumbs) <= 101
    points = crumbs.legs()[0].points
    assert points[-1] == (0.0, 0.0)
    assert points[0][0] == pytest.approx(100.0, abs=2.0)


def test_a_jump_leaves_a_gap_until_the_robot_comes_to_a_place_from_before_it():
    crumbs = Breadcrumbs(SE2(), steered=False)
    walk(crumbs, SE2(), 2.0)
    assert not crumbs.has_gap
    crumbs.record(SE2(2.0, 0.9, 0.0))
    assert not crumbs.has_gap
    crumbs.record(SE2(2.0, 5.0, 0.0))
    assert crumbs.has_gap
    pose = walk(crumbs, SE2(2.0, 5.0, -math.pi / 2), 4.0)
    assert crumbs.has_gap
    walk(crumbs, SE2(pose.x_m, pose.y_m, math.pi), 2.5)
    walk(crumbs, SE2(-0.5, 1.0, -math.pi / 4), 1.5)
    assert not crumbs.has_gap


def test_a_robot_found_elsewhere_and_back_again_has_no_gap():
    crumbs = Breadcrumbs(SE2(), steered=False)
    pose = walk(crumbs, SE2(), 1.0)
    before = crumbs.legs()
    crumbs.record(SE2(4.0, 4.0, 1.0))
    crumbs.record(pose)
    assert not crumbs.has_gap
    assert crumbs.legs() == before


@pytest.mark.parametrize("steps", range(4))
def test_a_gap_outlives_the_thinning_of_the_crumbs(steps):
    crumbs = Breadcrumbs(SE2(), steered=False, count_max=30)
    walk(crumbs, SE2(), 0.1 * steps)
    crumbs.record(SE2(3.0, 5.0, 0.0))
    walk(crumbs, SE2(3.0, 5.0, 0.0), 20.0)
    assert len(crumbs) <= 30
    assert crumbs.has_gap
    crumbs.truncate(1)
    assert not crumbs.has_gap
