"""Shapes of surroundings: found again whatever the heading, as fast as slow."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.shapes import REACH_M, PossiblePlaces, Shapes, shape_of
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


def anyhow(numbers):
    """Return keyframes that a new one may be at with any heading."""
    return PossiblePlaces(numbers, np.zeros(len(numbers)), np.full(len(numbers), 4.0))


@pytest.mark.parametrize("turn_deg", [-170.0, -90.0, -6.0, 0.0, 36.0, 119.0])
def test_a_place_is_found_again_with_the_heading_there(turn_deg):
    rng = np.random.default_rng(5)
    places = [surroundings(rng) for _ in range(40)]
    shapes = Shapes()
    for points in places:
        shapes.add([(SE2(), points)])
    # The robot stands 0.3 m beside the place, turned, and sees the same walls from there.
    there = SE2(0.2, -0.2, np.radians(turn_deg))
    shapes.add([(SE2(), moved(there.inverse(), places[17]))])
    best = shapes.alike(40, anyhow(np.arange(40)), 1, 0)[0]
    assert best.number == 17
    off = (best.turn_rad - there.theta_rad + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(off) <= 1.5 * SECTOR_RAD
    assert shapes.alike(40, anyhow(np.delete(np.arange(40), 17)), 1, 0)[0].score < best.score - 0.1


def test_scores_are_those_of_all_turns_tried_one_by_one():
    rng = np.random.default_rng(6)
    places = [surroundings(rng) for _ in range(12)]
    shapes = Shapes()
    for points in places:
        shapes.add([(SE2(), points)])
    new = shape_of(places[11])
    for each in shapes.alike(11, anyhow(np.arange(11)), 11, 0):
        old = shape_of(places[each.number])
        by_hand = [np.sum(np.roll(new, shift, axis=1) * old) for shift in range(60)]
        assert each.score == pytest.approx(max(by_hand), abs=1e-5)
        assert each.turn_rad == pytest.approx(
            np.angle(np.exp(1j * SECTOR_RAD * int(np.argmax(by_hand)))), abs=1e-9
        )


def test_a_heading_that_cannot_be_is_not_looked_at():
    points = surroundings(np.random.default_rng(10))
    shapes = Shapes()
    shapes.add([(SE2(), points)])
    shapes.add([(SE2(), moved(SE2(0.0, 0.0, -1.5), points))])
    right = PossiblePlaces(np.array([0]), np.array([1.5 - 2.0 * np.pi]), np.array([0.2]))
    assert shapes.alike(1, right, 1, 0)[0].turn_rad == pytest.approx(1.5, abs=SECTOR_RAD)
    wrong = PossiblePlaces(np.array([0]), np.array([0.5]), np.array([0.5]))
    assert 0.0 <= shapes.alike(1, wrong, 1, 0)[0].turn_rad <= 1.0


def test_what_earlier_keyframes_saw_counts_where_they_stood():
    rng = np.random.default_rng(7)
    points = surroundings(rng)
    before, far = SE2(1.0, 2.0, 0.7), SE2(REACH_M, 1.0, 0.0)
    seen = moved(before.inverse(), points)
    shapes = Shapes()
    shapes.add([(SE2(), points)])
    shapes.add([(before, seen), (far, seen)])
    assert shapes.alike(1, anyhow(np.array([0])), 1, 0)[0].score == pytest.approx(1.0, abs=1e-5)


def test_nothing_seen_is_like_nothing():
    shapes = Shapes()
    shapes.add([])
    shapes.add([(SE2(), surroundings(np.random.default_rng(8)))])
    assert shapes.alike(1, anyhow(np.array([0])), 1, 0)[0].score == 0.0


def test_one_of_thousands_is_found_and_neighbours_in_number_count_once():
    rng = np.random.default_rng(9)
    kinds = [surroundings(rng) for _ in range(30)]
    shapes = Shapes()
    for number in range(2000):
        shapes.add([(SE2(), kinds[number % 29])])
    shapes.add([(SE2(), kinds[29])])
    shapes.add([(SE2(), kinds[29])])
    found = shapes.alike(2001, anyhow(np.arange(2001)), 3, 6)
    assert found[0].number == 2000
    assert found[0].score == pytest.approx(1.0, abs=1e-5)
    assert all(abs(a.number - b.number) > 6 for a in found for b in found if a is not b)
