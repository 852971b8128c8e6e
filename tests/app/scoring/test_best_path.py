"""The best path against lengths that are known."""

import math

import numpy as np
import pytest

from firmware_sim.world.world import World
from robotctl.app.scoring.best_path import best_path
from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.mission.mission_file import parse_mission

HEAD = 'name = "m"\nworld = "w"\nstart = { x_m = 1.0, y_m = 1.0 }\n'
ROOM = [(0, 0, 8, 0), (8, 0, 8, 4), (8, 4, 0, 4), (0, 4, 0, 0)]


def best(robot, items, walls=()):
    mission = parse_mission(HEAD + items, "m.toml")
    room = World.from_segments(np.array([*ROOM, *walls], float))
    return best_path(load_robot(find_file(robot)), room, SE2(1.0, 1.0, 0.0), mission)


@pytest.mark.parametrize("robot", ["diff_drive", "ackermann"])
def test_straight_to_two_goals_it_is_their_distance_at_the_speed_of_each(robot):
    found = best(
        robot,
        '[[item]]\nkind = "goto"\nx_m = 4.0\ny_m = 1.0\nspeed_m_s = 0.3\n'
        '[[item]]\nkind = "goto"\nx_m = 6.0\ny_m = 1.0\nspeed_m_s = 9.0\n',
    )
    assert found.length_m == pytest.approx(5.0, abs=0.02)
    assert found.time_s == pytest.approx(3.0 / 0.3 + 2.0 / 0.8, rel=0.01)


def test_it_leads_round_what_stands_there_and_there_is_none_where_that_closes_the_way():
    goal = '[[item]]\nkind = "goto"\nx_m = 7.0\ny_m = 1.0\n'
    round_m = 2.0 * math.hypot(3.0, 2.0)  # by (4, 3), the end of the wall, and the robot's width
    found = best("diff_drive", goal, [(4, 0, 4, 3)])
    assert round_m < found.length_m < round_m + 0.6
    assert best("diff_drive", goal, [(4, 0, 4, 4)]) is None


WAIT = '[[item]]\nkind = "wait"\nduration_s = 1.5\n'


def test_a_mission_that_does_more_than_drive_to_goals_has_none():
    goal = '[[item]]\nkind = "goto"\nx_m = 7.0\ny_m = 1.0\n'
    assert best("diff_drive", goal + '[[item]]\nkind = "turn_to"\nheading_deg = 90.0\n') is None


def test_a_wait_takes_its_time():
    goal = '[[item]]\nkind = "goto"\nx_m = 7.0\ny_m = 1.0\n'
    plain, waits = (best("diff_drive", goal + more) for more in ("", WAIT))
    assert waits.length_m == plain.length_m
    assert waits.time_s == pytest.approx(plain.time_s + 1.5)


def test_a_world_that_no_wall_encloses_has_a_best_path_too():
    """A warehouse's shelves stand free, and its goals lie beyond the outermost of them."""
    goal = '[[item]]\nkind = "goto"\nx_m = 7.0\ny_m = 3.0\nspeed_m_s = 0.5\n'
    mission = parse_mission(HEAD + goal, "m.toml")
    walls = np.array(
        [(3, 1.4, 4, 1.4), (4, 1.4, 4, 0.2), (-1, -1, -1, -0.8), (9, 5, 9, 5.2)], float
    )
    room = World.from_segments(walls)
    found = best_path(load_robot(find_file("diff_drive")), room, SE2(1.0, 1.0, 0.0), mission)
    assert math.hypot(6.0, 2.0) <= found.length_m < 7.0
    assert found.time_s == pytest.approx(found.length_m / 0.5)
