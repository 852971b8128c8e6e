"""The registry of behaviours: all that is asked for has an entry, and each can be begun."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ExploreRequest, PlaceRequest, PositionRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.circle import CircleItem
from robotctl.planning.behave.behaviours.dock import DockItem
from robotctl.planning.behave.behaviours.explore import ExploreItem
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.follow_wall import FollowWallItem, Until
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.goto_place import GotoPlaceItem
from robotctl.planning.behave.behaviours.keep_distance import KeepDistanceItem
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.registry import BEHAVIOURS, behaviour_for
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.behaviours.turn_to import TurnToItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.behave.behaviours.wait_for import WaitForItem
from robotctl.planning.behave.journey.pilot import MapPilot
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.map.seen import Seen
from tests.planning.behave.journey.bench import BODY, LIMITS
from tests.planning.map.topological.little_world import little_world

WANTED = [
    DriveItem("drive", ((0.0, 0.0), (2.0, 0.0))),
    FollowWallItem("follow_wall", "right", 1.0, Until(length_m=3.0)),
    StraightToItem("straight_to", 2.0, 1.0),
    TurnToItem("turn_to", 90.0),
    WaitItem("wait", 2.0),
    GotoItem("goto", 2.0, 1.0),
    ExploreItem("explore"),
    GotoPlaceItem("goto_place", "den"),
    PositionRequest(2.0, 1.0),
    DockItem("dock", 0.2),
    KeepDistanceItem("keep_distance", 0.5, 10.0),
    CircleItem("circle", 2.0, 1.0, 0.8),
    ExploreRequest(),
    PlaceRequest("den"),
    WaitForItem("wait_for", go_ahead=True),
    Mode.RTL,
]


@pytest.mark.parametrize("wanted", WANTED, ids=lambda each: type(each).__name__)
def test_each_can_be_made_paused_and_begun_anew(wanted, differential) -> None:
    config = NavigationConfig()
    guard = ObstacleGuard(config.guard, differential.mounts)
    crumbs = Breadcrumbs(SE2(), steered=False)
    for step in range(5):
        crumbs.record(SE2(0.1 * step, 0.0, 0.0))
    robot = NavigatedRobot(config, differential.drive, differential.mounts, guard, crumbs)
    pilot = MapPilot(
        config,
        differential.drive,
        LIMITS,
        BODY,
        differential.mounts,
        None,
        SE2(),
        lidars=1,
        topology=little_world().map,
    )
    nothing = RangeScan(1, np.linspace(-3.0, 3.0, 90), np.full(90, math.inf), 6.0)
    pilot.see(SE2(), Seen(SE2(), ((SE2(), nothing),)), 10**9)
    robot.pilot = pilot
    behaviour = behaviour_for(wanted, robot)
    clear = (float("inf"),) * len(differential.mounts)
    situation = BehaviourInput(SE2(), Twist(0.0, 0.0), clear, (True,) * len(clear))
    for prepare in (behaviour.pause, behaviour.reset, lambda: behaviour.resume(0.0)):
        prepare()
        step = behaviour.step(situation, 10**9)
        assert step.status is not Status.FAILED


def test_all_that_is_registered_is_tried_here() -> None:
    assert {each if isinstance(each, Mode) else type(each) for each in WANTED} == set(BEHAVIOURS)
