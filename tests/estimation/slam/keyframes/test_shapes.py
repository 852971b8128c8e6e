"""Shapes of surroundings: found again whatever the heading, as fast as slow."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.candidates import PossiblePlaces
from robotctl.estimation.slam.keyframes.shapes import REACH_M, Shapes, shape_of
from robotctl.estimation.slam_config import ShapeConfig
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2

SECTOR_RAD = np.radians(6.0)


def surroundings(rng):
    """Return points on eight pieces of wall around the origin, (n, 2)."""
    begins = rng.uniform(-REACH_M, REACH_M, (8, 1, 2))
    along = np.arange(0.0, 3.0, 0.03)[None, :, None]
    heading = rng.uniform(0.0, 2.0 * np.pi, 8)
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1)[:, None]
    return (begins + along * step).reshape(-1, 2)


def anyhow(number, among):
    """Return keyframes that one may be at with any heading."""
    return PossiblePlaces(number, among, np.zeros(len(among)), np.full(len(among), 4.0))


def shapes_of(candidates, apart=0):
    return Shapes(ShapeConfig(candidates, apart, least_score=0.0))


def alike(shapes, number, among):
    return shapes.suggest(anyhow(number, among)).candidates


@pytest.mark.parametrize("turn_deg", [-170.0, -90.0, -6.0, 0.0, 36.0, 119.0])
def test_a_place_is_found_again_with_the_heading_there(turn_deg):
    rng = np.random.default_rng(5)
    places = [surroundings(rng) for _ in range(40)]
    shapes = shapes_of(1)
    for points in places:
        shapes.add([(SE2(), points)])
    # The robot stands 0.3 m beside the place, turned, and sees the same walls from there.
    there = SE2(0.2, -0.2, np.radians(turn_deg))
    shapes.add([(SE2(), moved(there.inverse(), places[17]))])
    best = alike(shapes, 40, np.arange(40))[0]
    assert best.place == 17
    off = (best.pose.theta_rad - there.theta_rad + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(off) <= 1.5 * SECTOR_RAD
    assert alike(shapes, 40, np.delete(np.arange(40), 17))[0].score < best.score - 0.1


def test_scores_are_those_of_all_turns_tried_one_by_one():
    rng = np.random.default_rng(6)
    places = [surroundings(rng) for _ in range(12)]
    shapes = shapes_of(11)
    for points in places:
        shapes.add([(SE2(), points)])
    new = shape_of(places[11])
    for each in alike(shapes, 11, np.arange(11)):
        old = shape_of(places[each.place])
        by_hand = [np.sum(np.roll(new, shift, axis=1) * old) for shift in range(60)]
        assert each.score == pytest.approx(max(by_hand), abs=1e-5)
        assert each.pose.theta_rad == pytest.approx(
            np.angle(np.exp(1j * SECTOR_RAD * int(np.argmax(by_hand)))), abs=1e-9
        )


def test_a_heading_that_cannot_be_is_not_looked_at():
    points = surroundings(np.random.default_rng(10))
    shapes = shapes_of(1)
    shapes.add([(SE2(), points)])
    shapes.add([(SE2(), moved(SE2(0.0, 0.0, -1.5), points))])
    right = PossiblePlaces(1, np.array([0]), np.array([1.5 - 2.0 * np.pi]), np.array([0.2]))
    assert shapes.suggest(right).candidates[0].pose.theta_rad == pytest.approx(1.5, abs=SECTOR_RAD)
    wrong = PossiblePlaces(1, np.array([0]), np.array([0.5]), np.array([0.5]))
    assert 0.0 <= shapes.suggest(wrong).candidates[0].pose.theta_rad <= 1.0


def test_what_earlier_keyframes_saw_counts_where_they_stood():
    rng = np.random.default_rng(7)
    points = surroundings(rng)
    before, far = SE2(1.0, 2.0, 0.7), SE2(REACH_M, 1.0, 0.0)
    seen = moved(before.inverse(), points)
    shapes = shapes_of(1)
    shapes.add([(SE2(), points)])
    shapes.add([(before, seen), (far, seen)])
    assert alike(shapes, 1, np.array([0]))[0].score == pytest.approx(1.0, abs=1e-5)


def test_nothing_seen_is_like_nothing():
    shapes = shapes_of(1)
    shapes.add([])
    shapes.add([(SE2(), surroundings(np.random.default_rng(8)))])
    assert alike(shapes, 1, np.array([0])) == ()


def test_one_of_thousands_is_found_and_neighbours_in_number_count_once():
    rng = np.random.default_rng(9)
    kinds = [surroundings(rng) for _ in range(30)]
    shapes = shapes_of(3, apart=6)
    for number in range(2000):
        shapes.add([(SE2(), kinds[number % 29])])
    shapes.add([(SE2(), kinds[29])])
    shapes.add([(SE2(), kinds[29])])
    found = alike(shapes, 2001, np.arange(2001))
    assert found[0].place == 2000
    assert found[0].score == pytest.approx(1.0, abs=1e-5)
    assert all(abs(a.place - b.place) > 6 for a in found for b in found if a is not b)
