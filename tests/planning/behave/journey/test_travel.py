"""Driving by places in a little world, with an odometry that is turned, elsewhere, and drifts."""

import math
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput, Status
from robotctl.planning.behave.journey.approach import Approach
from robotctl.planning.behave.journey.travel import Travel
from robotctl.planning.config import JourneyConfig
from robotctl.planning.map.topological.recognition import appearances
from tests.planning.map.topological.little_world import LittleWorld, corridors, little_world

STEP_NS = 200_000_000
DRIFT_M, DRIFT_RAD = 0.03, 0.01
"""Of odometry, per metre."""


@pytest.fixture(scope="module")
def looks():
    return appearances(little_world().map)


class Robot:
    """A robot that gets about its little world perfectly, but does not know where it is.

    It is its own pilot: goals are in `odom`, of which it knows the truth.
    """

    def __init__(self, world: LittleWorld, start: SE2) -> None:
        self.world = world
        self.truth = start
        self.odom = SE2(-40.0, 7.0, 2.0)
        self.now_ns = 10**9
        self.rooms = [world.room_at(start.x_m, start.y_m)]
        self.said: Counter[str] = Counter()
        self.blindness = ""
        self.has_time = self.has_lidar = True
        self._path = []

    @property
    def last_scan(self):
        return (self.odom, self.world.scan(self.truth, self.now_ns)) if self.has_lidar else None

    def journey(self, goal, _speed_m_s):
        there = self.truth @ (self.odom.inverse() @ SE2(goal.x_m, goal.y_m, 0.0))
        self._path = self.world.way(self.truth, (there.x_m, there.y_m))
        near = math.hypot(there.x_m - self.truth.x_m, there.y_m - self.truth.y_m) < 0.15
        return SimpleNamespace(step=lambda *_: self._follow(near))

    def _follow(self, near):
        if not self._path:
            return BehaviourOutput(0.0, 0.0, Status.DONE if near else Status.FAILED, "a wall")
        self._move(self._path.pop(0))
        status = Status.RUNNING if self._path else Status.DONE
        return BehaviourOutput(0.5, 0.0, status)

    def touches(self, poses):
        at = [self.truth @ (self.odom.inverse() @ SE2(*pose)) for pose in poses.tolist()]
        around = [(each @ SE2(0.2, 0.0, 0.0), each @ SE2(-0.2, 0.0, 0.0)) for each in at]
        points = np.array([(end.x_m, end.y_m) for ends in around for end in ends])
        return not self.world.is_free(*points.T).all()

    def exploration(self):
        self._path = self.world.way(self.truth, (2.7, 2.0))
        return SimpleNamespace(step=lambda *_: self._follow(near=True))

    def _move(self, to):
        """Go to a point, facing it; odometry does the same with an error."""
        dx, dy = to[0] - self.truth.x_m, to[1] - self.truth.y_m
        way_m, heading_rad = math.hypot(dx, dy), math.atan2(dy, dx)
        motion = self.truth.inverse() @ SE2(*to, heading_rad)
        self.truth = self.truth @ motion
        self.odom = self.odom @ motion @ SE2(DRIFT_M * way_m, 0.0, DRIFT_RAD * way_m)
        room = self.world.room_at(*to)
        if room and room != self.rooms[-1]:
            self.rooms.append(room)

    def drive(self, travel, until=lambda: False):
        for _ in range(2000):
            situation = BehaviourInput(self.odom, Twist(0.0, 0.0), (), ())
            output = travel.step(situation, self.now_ns)
            self.now_ns += STEP_NS
            self.said[output.text] += 1
            if output.status is not Status.RUNNING or until():
                return output
        raise AssertionError(f"still under way: {output.text}")

    def says(self, text):
        return any(text in said for said in self.said)


def travel(robot, looks, goal, start=""):
    tools = SimpleNamespace(world=robot, paths=robot, journey=JourneyConfig())
    places = SimpleNamespace(map=robot.world.map, looks=looks)
    approach = Approach(robot, robot.journey, 0.5)
    return Travel(tools, places, approach, robot.exploration, goal, start)


@pytest.mark.parametrize(
    ("start", "goal", "rooms"),
    [
        (SE2(4.0, 1.5, 0.3), "study", ["hall", "study"]),
        (SE2(8.0, 1.5, -2.0), "store", ["study", "store"]),
        (SE2(4.5, 6.5, 1.0), "study", None),
        (SE2(8.0, 6.0, 2.5), "hall", None),
    ],
)
def test_it_arrives_wherever_it_is_put_down(start, goal, rooms, looks):
    robot = Robot(little_world(), start)
    output = robot.drive(travel(robot, looks, goal))
    assert output.status is Status.DONE, output.text
    assert robot.world.room_at(robot.truth.x_m, robot.truth.y_m) == goal
    assert rooms is None or robot.rooms == rooms


def test_who_is_there_drives_to_the_middle(looks):
    robot = Robot(little_world(), SE2(1.5, 1.0, 0.0))
    assert robot.drive(travel(robot, looks, "hall")).text == "in hall"
    assert robot.rooms == ["hall"]


def test_a_wrong_start_is_noticed(looks):
    robot = Robot(little_world(), SE2(4.5, 6.5, 1.0))
    assert robot.drive(travel(robot, looks, "hall", start="study")).status is Status.DONE
    assert robot.says("this does not look like study")
    assert robot.rooms == ["den", "hall"]


def test_a_robot_that_is_carried_away_goes_on_from_there(looks):
    robot = Robot(little_world(), SE2(1.5, 1.0, 0.0))
    behaviour = travel(robot, looks, "store")
    robot.drive(behaviour, until=lambda: robot.truth.x_m > 3.0)
    robot.truth = SE2(4.5, 6.5, -1.0)  # to the den, and odometry does not know
    robot.rooms.append("den")
    behaviour.pause()  # its way is not that of before
    output = robot.drive(behaviour)
    assert output.status is Status.DONE, output.text
    assert robot.says("recognised den")
    assert robot.world.room_at(robot.truth.x_m, robot.truth.y_m) == "store"


def test_a_closed_door_is_driven_round(looks):
    world = LittleWorld(little_world().map, closed=(("hall", "study"),))
    robot = Robot(world, SE2(4.0, 1.5, 0.3))
    output = robot.drive(travel(robot, looks, "study"))
    assert output.status is Status.DONE, output.text
    # The pilot sees a way to the passage on its other side: that counts as not getting there. From
    # the den the way through the store is the shorter one.
    assert robot.rooms == ["hall", "den", "store", "study"]


def test_what_stands_right_behind_a_door_is_driven_round(looks):
    boxes = ((6.95, 1.4, 7.3, 1.9), (8.1, 1.3, 8.6, 1.8))  # there, and in the middle of the study
    robot = Robot(LittleWorld(little_world().map, boxes=boxes), SE2(4.0, 1.5, 0.3))
    output = robot.drive(travel(robot, looks, "study"))
    assert (output.status, output.text) == (Status.DONE, "in study")
    assert robot.rooms == ["hall", "study"]
    assert not robot.says("not reached")


def test_it_gives_up_where_all_ways_are_closed_and_says_why(looks):
    world = LittleWorld(little_world().map, closed=(("hall", "study"), ("study", "store")))
    robot = Robot(world, SE2(4.0, 1.5, 0.3))
    output = robot.drive(travel(robot, looks, "study"))
    assert output.status is Status.FAILED
    assert "to study; passage" in output.text
    assert output.text.count(": a wall") == 2


def test_it_gives_up_after_so_many_looks_where_nothing_is_known(looks):
    robot = Robot(little_world(), SE2(4.0, 1.5, 0.3))
    places = {"store": looks["store"]}
    seen = []
    robot.exploration = lambda: (
        seen.append(1) or SimpleNamespace(step=lambda *_: BehaviourOutput(0.0, 0.0, Status.DONE))
    )
    output = robot.drive(travel(robot, places, "store"))
    assert output.status is Status.FAILED
    assert output.text.startswith("gave up after 8 looks around: ")
    assert len(seen) == 8


def test_without_scans_it_stands_and_gives_up(looks):
    robot = Robot(little_world(), SE2(4.0, 1.5, 0.3))
    robot.blindness = "the lidar gives no scans"
    output = robot.drive(travel(robot, looks, "study"))
    assert output == BehaviourOutput(0.0, 0.0, Status.FAILED, "the lidar gives no scans for 10 s")
    robot.blindness, robot.has_lidar = "", False
    output = robot.drive(travel(robot, looks, "study"))
    reason = "no echo of a lidar comes to recognise places by for 10 s"
    assert output == BehaviourOutput(0.0, 0.0, Status.FAILED, reason)
    assert np.isclose(robot.truth.x_m, 4.0)


def test_corridors_and_the_junction_between_are_driven_as_places():
    """From room to room: the corridor, where another one branches off it, that one."""
    world = corridors()
    robot = Robot(world, SE2(2.5, 1.5, -2.0))
    output = robot.drive(travel(robot, appearances(world.map), "lab"))
    assert output == BehaviourOutput(0.0, 0.0, Status.DONE, "in lab")
    assert robot.rooms == ["office", "west", "crossing", "north", "lab"]
    for name in ("west", "crossing", "north"):
        assert robot.says(f": {name}"), name
    assert sum(robot.said[text] for text in robot.said if text.startswith("recognised")) == 1
