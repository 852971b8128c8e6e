"""The registry of behaviours: all that is asked for has an entry, and a new one is one line."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import PositionRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behaviours.follow_path import DriveItem
from robotctl.planning.behaviours.follow_wall import FollowWallItem, Until
from robotctl.planning.behaviours.go_to import GoToItem
from robotctl.planning.behaviours.kind import NavigatedRobot
from robotctl.planning.behaviours.registry import BEHAVIOURS, behaviour_for
from robotctl.planning.behaviours.turn_to import TurnToItem
from robotctl.planning.behaviours.wait import WaitItem
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.behaviour import BehaviourInput, Status
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

WANTED = [
    DriveItem("drive", ((0.0, 0.0), (2.0, 0.0))),
    FollowWallItem("follow_wall", "right", 1.0, Until(length_m=3.0)),
    GoToItem("go_to", 2.0, 1.0),
    TurnToItem("turn_to", 90.0),
    WaitItem("wait", 2.0),
    PositionRequest(2.0, 1.0),
    Mode.RTL,
]

NEW = """
from dataclasses import dataclass
from typing import Literal

from robotctl.planning.behaviours.kind import Kind
from robotctl.planning.behaviours.registry import BEHAVIOURS
from robotctl.planning.guard.behaviour import Behaviour, BehaviourOutput, done


@dataclass(frozen=True, slots=True)
class BackUpItem:
    kind: Literal["back_up"]
    length_m: float
    name: str = ""


class BackUp(Behaviour):
    def __init__(self, length_m):
        self.length_m, self.begin = length_m, None

    def reset(self):
        self.begin = None

    def pause(self):
        pass

    def step(self, situation, now_ns):
        self.begin = self.begin or situation.pose
        if self.begin.x_m - situation.pose.x_m >= self.length_m:
            return done()
        return BehaviourOutput(-0.2, 0.0, text="backing up")


BEHAVIOURS[BackUpItem] = Kind(lambda item, robot: BackUp(item.length_m))  # the line

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.planning.behaviours.mission import parse_mission
from robotctl.planning.config import NavigationConfig
from robotctl.planning.navigator import NavigationInputs, Navigator

TEXT = '''
name = "new"
world = "flat"
start = { x_m = 0.0, y_m = 0.0 }
[[item]]
kind = "back_up"
length_m = 0.5
'''
limits = LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0)
drive = DifferentialDrive("differential", 0.3, 0.05, 2400)
mission = parse_mission(TEXT, "new.toml")
navigator = Navigator(NavigationConfig(), drive, limits, (), mission, SE2())
pose, wish = SE2(), (ModeRequest(Mode.AUTO),)
for step in range(200):
    inputs = NavigationInputs(pose, Twist(0.0, 0.0), (), (), True, wish)
    out, wish = navigator.step(inputs, step * 50_000_000), ()
    pose = integrate(pose, out.v_m_s, out.omega_rad_s, 0.05)
print(out.mission_completed, round(pose.x_m, 1), out.message)
"""


@pytest.mark.parametrize("wanted", WANTED, ids=lambda each: type(each).__name__)
def test_each_can_be_made_paused_and_begun_anew(wanted, differential) -> None:
    config = NavigationConfig()
    guard = ObstacleGuard(config.guard, differential.mounts)
    crumbs = Breadcrumbs(SE2(), steered=False)
    for step in range(5):
        crumbs.record(SE2(0.1 * step, 0.0, 0.0))
    robot = NavigatedRobot(config, differential.drive, differential.mounts, guard, crumbs)
    behaviour = behaviour_for(wanted, robot)
    clear = (float("inf"),) * len(differential.mounts)
    situation = BehaviourInput(SE2(), Twist(0.0, 0.0), clear, (True,) * len(clear))
    for prepare in (behaviour.pause, behaviour.reset, lambda: behaviour.resume(0.0)):
        prepare()
        step = behaviour.step(situation, 10**9)
        assert step.status is not Status.FAILED


def test_all_that_is_registered_is_tried_here() -> None:
    assert {each if isinstance(each, Mode) else type(each) for each in WANTED} == set(BEHAVIOURS)


def test_a_new_behaviour_is_one_file_and_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-c", NEW], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "True -0.5 mission new completed"
