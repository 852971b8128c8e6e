"""Who walked and stops is remembered as long as something is marked there."""

import numpy as np
import pytest

from robotctl.planning.map.standing import StandingPeople

S = 10**9


class Marks:
    """Places at which something is marked."""

    def __init__(self, *places):
        self.places = list(places)

    def __call__(self, x_m, y_m):
        return any(np.hypot(x_m - x, y_m - y) < 0.35 for x, y in self.places)


def walkers(*places):
    return np.array([(*place, 0.8, 0.0, 0.2) for place in places]).reshape(-1, 5)


def stop(people, marks, *places, now_ns=0):
    """Have people walk up to places, and stop there."""
    people.see(walkers(*places), marks, now_ns)
    people.see(walkers(), marks, now_ns + S // 10)


def test_who_stops_where_something_is_marked_stands():
    people, marks = StandingPeople(), Marks((2.0, 1.0))
    stop(people, marks, (2.0, 1.0), (5.0, 1.0))  # one is only out of sight
    people.see(walkers(), marks, 3 * S)
    assert people.places.tolist() == [[2.0, 1.0]]


def test_who_walks_on_or_has_gone_stands_no_more():
    marks = Marks((2.0, 1.0), (3.0, 1.0))
    people = StandingPeople()
    stop(people, marks, *marks.places)
    people.see(walkers((2.3, 1.0)), marks, 3 * S)
    assert people.places.tolist() == [[3.0, 1.0]]
    marks.places.clear()
    people.see(walkers((2.7, 1.0)), marks, 4 * S)
    assert not len(people.places)


def test_who_never_stirs_for_minutes_may_be_a_thing():
    people, marks = StandingPeople(), Marks((2.0, 1.0))
    stop(people, marks, (2.0, 1.0))
    people.see(walkers(), marks, 100 * S)
    assert len(people.places) == 1
    people.see(walkers(), marks, 130 * S)
    assert not len(people.places)


def test_one_who_stops_twice_at_a_place_is_one():
    people, marks = StandingPeople(), Marks((2.0, 1.0))
    stop(people, marks, (2.0, 1.0))
    stop(people, marks, (2.1, 1.0), now_ns=S)
    assert len(people.places) == 1


def test_after_a_jump_of_the_pose_nobody_is_known():
    people, marks = StandingPeople(), Marks((2.0, 1.0))
    stop(people, marks, (2.0, 1.0))
    people.forget()
    assert not len(people.places)


def test_gaps_are_between_neighbours_in_a_line():
    people, marks = StandingPeople(), Marks((0.0, 0.0), (1.2, 0.0), (2.4, 0.9))
    stop(people, marks, (0.0, 0.0), (1.2, 0.0), (2.4, 0.9))
    assert people.gaps(1.3).tolist() == [[pytest.approx(0.6), 0.0, pytest.approx(0.6)]]
    assert len(people.gaps(1.5)) == 2
    assert not len(people.gaps(0.0))
