"""The view of a plan: how often, how much of it, and in whose numbers."""

import numpy as np

from robotctl.core.plan_view import PlanViews
from robotctl.messages.map_message import grid_of
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.behave.behaviours.outlook import NOWHERE, Outlook

COSTS = GridMap(np.array([[0, 100, -1], [50, 7, 0]], np.int8), 0.1, SE2(1.0, -2.0, 0.5))
PATH = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, -0.25]])


def outlook(obstacles=3):
    places = np.column_stack([np.arange(obstacles), np.zeros(obstacles)])
    return Outlook(PATH, NOWHERE, places, np.array([[1.0, 2.0, 0.5, 0.0, 0.25]]), COSTS)


def test_a_view_says_what_the_pilot_says():
    (view,) = PlanViews(outlook).of(7)
    assert view.stamp_ns == 7
    np.testing.assert_array_equal(np.frombuffer(view.path, "<f4").reshape(-1, 3), PATH)
    assert view.arc == b""
    places = np.frombuffer(view.obstacles, "<f4").reshape(-1, 2)
    np.testing.assert_array_equal(places, [[0, 0], [1, 0], [2, 0]])
    assert view.moving == ((1.0, 2.0, 0.5, 0.0, 0.25),)
    costs = grid_of(view.costs)
    np.testing.assert_array_equal(costs.cells, COSTS.cells)
    assert (costs.resolution_m, costs.origin) == (COSTS.resolution_m, COSTS.origin)


def test_views_come_five_times_a_second_and_none_without_a_pilot():
    views = PlanViews(outlook)
    stamps = [ms for ms in range(0, 1000, 50) if views.of(ms * 1_000_000)]
    assert stamps == [0, 200, 400, 600, 800]
    assert PlanViews(lambda: None).of(0) == []


def test_of_very_many_obstacles_some_are_shown_from_everywhere():
    (view,) = PlanViews(lambda: outlook(9001)).of(0)
    shown = np.frombuffer(view.obstacles, "<f4").reshape(-1, 2)[:, 0]
    assert 1000 <= len(shown) <= 2000
    assert shown[0] == 0.0
    assert shown[-1] > 8990.0
    (empty,) = PlanViews(lambda: outlook(0)).of(0)
    assert empty.obstacles == b""
