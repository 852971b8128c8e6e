"""Echoes that count while no sonar looks there any more."""

import math

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard.echo_memory import EchoMemory
from robotctl.planning.guard.obstacle_guard import GuardConfig, ObstacleGuard
from tests.planning.costmap.rays import echo

MOUNTS = (
    SonarMount("front", 0.18, 0.0, 0.0),
    SonarMount("left", 0.0, 0.15, 90.0),
    SonarMount("rear", -0.15, 0.0, 180.0),
)
STEP_NS = 50_000_000
NEW = (True, True, True)


def readings(left=math.nan, front=math.nan, rear=math.nan):
    return (front, left, rear), tuple(not math.isnan(each) for each in (front, left, rear))


def fed(*steps, pose=None):
    """Return a memory that has taken readings at poses, one after the other."""
    memory = EchoMemory(MOUNTS)
    for k, step in enumerate(steps):
        memory.take(pose or SE2(), *step, k * STEP_NS)
    return memory


def test_an_echo_counts_once_two_readings_have_it():
    assert fed(readings(left=0.2)).around(SE2()).shape == (0, 2)
    assert fed(readings(left=0.2), readings(left=0.4)).around(SE2()).shape == (0, 2)
    twice = fed(readings(left=0.2), readings(), readings(left=0.22))
    assert twice.around(SE2()) == pytest.approx(np.array([[0.0, 0.37]]))
    assert fed(readings(left=0.7), readings(left=0.7)).around(SE2()).shape == (0, 2)


def test_points_stay_where_they_are_as_the_robot_moves():
    pose = SE2(1.0, 2.0, 0.5)
    memory = fed(readings(left=0.2), readings(left=0.2), pose=pose)
    place = pose.apply(0.0, 0.35)
    later = SE2(1.2, 2.1, -0.4)
    memory.take(later, *readings(), 3 * STEP_NS)
    assert later.apply(*memory.around(later)[0]) == pytest.approx(place)
    far = pose @ SE2(1.1, 0.0, 0.0)
    memory.take(far, *readings(), 4 * STEP_NS)
    assert len(memory.around(far)) == 0


def test_an_echo_from_behind_shows_that_a_thing_is_gone_and_silence_does_not():
    seen = [readings(left=0.2)] * 2
    assert len(fed(*seen, readings(left=math.inf)).around(SE2())) == 1
    assert len(fed(*seen, readings(left=0.29)).around(SE2())) >= 1
    assert len(fed(*seen, readings(left=0.5)).around(SE2())) == 0
    assert len(fed(*seen, readings(front=0.5, rear=0.5)).around(SE2())) == 1


def test_after_a_while_it_is_forgotten():
    memory = fed(readings(left=0.2), readings(left=0.2))
    memory.take(SE2(), *readings(), 15_000_000_000 + STEP_NS)
    assert len(memory.around(SE2())) == 1
    memory.take(SE2(), *readings(), 15_000_000_000 + 2 * STEP_NS)
    assert len(memory.around(SE2())) == 0
    memory = fed(readings(left=0.2), readings(left=0.2))
    memory.reset()
    assert len(memory.around(SE2())) == 0


def test_a_wall_beside_is_a_row_of_points_and_stays_one():
    memory = EchoMemory(MOUNTS)
    for k in range(400):
        memory.take(SE2(0.3 * math.sin(0.02 * k), 0.0, 0.0), *readings(left=0.2), k * STEP_NS)
    points = memory.around(SE2())
    assert points[:, 1] == pytest.approx(0.35, abs=0.03)
    assert 12 <= len(points) <= 15


def test_the_edge_of_a_door_that_was_passed_hinders_the_turn_that_would_touch_it():
    """The rear left corner of the robot would swing against the post beside it."""
    post = [(0.0, 0.24, 0.03)]
    memory, guard = EchoMemory(MOUNTS), ObstacleGuard(GuardConfig(), MOUNTS)
    for k in range(20):
        pose = SE2(-0.3 + 0.02 * k, 0.0, 0.0)
        ranges = tuple(echo(pose, mount, (), post) for mount in MOUNTS)
        memory.take(pose, ranges, NEW, k * STEP_NS)
    assert ranges == (math.inf,) * 3  # it has left all cones
    guard.observe(ranges, NEW, (), memory.around(pose))
    assert guard.step(0.0, -1.0).v_max_m_s < 0.3
    guard.observe(ranges, NEW)
    assert guard.step(0.0, -1.0).v_max_m_s == math.inf
