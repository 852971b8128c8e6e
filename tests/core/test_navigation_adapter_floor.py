"""What the adapter remembers of the floor over stops and restarts."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import (
    ControlState,
    LoopStatistics,
    ManualControl,
    Mode,
    NavigationState,
    SafetyState,
    SetMode,
    VelocityCommand,
)
from robotctl.messages.estimation import CameraView

CONFIG = load_robot(find_file("diff_drive"), ("camera.enabled=true",))
STATE = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
MISSION = """
name = "ahead"
world = "flat"
start = { x_m = 0.0, y_m = 0.0 }
[[item]]
kind = "drive"
waypoints = [[0.0, 0.0], [9.0, 0.0]]
"""
CAMERA_X_M, NEAREST_M = 0.15, 0.25
ANGLES_RAD = np.radians(np.arange(-35.0, 36.0))
UP_TO_IT = 0.65
"""There the plank is 0.15 m before the robot's nose, and 0.05 m below the picture."""


class Looking:
    """A adapter that looks at the floor: free, or with a plank across the way at x = 1 m."""

    def __init__(self, folder: Path, armings: int = 0) -> None:
        path = folder / "mission.toml"
        path.write_text(MISSION)
        self.options = StackOptions("x", "", mission=str(path))
        self.adapter = make_navigation(CONFIG, self.options)
        self.now_ns = 10**12
        self.state = SafetyState.STANDBY
        self.armings = armings
        self.odom_epoch_ns = 1
        self.x_m = 0.0
        self.plank = True
        self.late_ns: int | None = 0
        """Age of the pictures [ns]; None: there are none."""
        self.step()

    def step(self, mode: Mode | None = None) -> tuple[VelocityCommand, NavigationState]:
        """Step once, with a picture of where the robot stands now."""
        self.now_ns += self.adapter.period_ns
        requests = () if mode is None else (SetMode(self.now_ns, mode),)
        views = [] if self.late_ns is None else [self.view()]
        return self.adapter.step(self.control(), None, requests, self.now_ns, views)

    def drive_to(self, x_m: float) -> None:
        """Move along x in steps of a centimetre or less; the operator steers."""
        for x in np.linspace(self.x_m, x_m, 2 + round(abs(x_m - self.x_m) / 0.01)).tolist():
            self.x_m = x
            self.step()

    def arm(self) -> None:
        """Arm the robot."""
        self.state, self.armings = SafetyState.ARMED, self.armings + 1
        self.step()

    def stop(self, state: SafetyState) -> None:
        """Stop the robot, for a while."""
        self.state = state
        for _ in range(5):
            self.step()

    def auto(self) -> tuple[VelocityCommand, NavigationState]:
        """Ask for AUTO; return what came of it."""
        return self.step(Mode.AUTO)

    def control(self) -> ControlState:
        """Return the state of control."""
        return msgspec.structs.replace(
            STATE,
            stamp_ns=self.now_ns,
            state=self.state,
            armings=self.armings,
            x_m=self.x_m,
            v_m_s=0.0,
            omega_rad_s=0.0,
            vy_m_s=0.0,
            sonar_m=(math.inf,) * len(CONFIG.sonar),
            sonar_stamp_ns=(self.now_ns,) * len(CONFIG.sonar),
            odom_epoch_ns=self.odom_epoch_ns,
        )

    def view(self) -> CameraView:
        """Return what the camera sees."""
        ranges = np.full(len(ANGLES_RAD), math.inf)
        if self.plank:
            plank = (1.0 - self.x_m - CAMERA_X_M) / np.cos(ANGLES_RAD)
            ranges = np.where(plank >= NEAREST_M, plank, ranges)
        count = len(ranges)
        return CameraView(
            self.now_ns - (self.late_ns or 0),
            CAMERA_X_M,
            0.0,
            4.0,
            tuple(ANGLES_RAD.tolist()),
            tuple(ranges.tolist()),
            (0.01,) * count,
            (NEAREST_M,) * count,
        )


def waits(came: tuple[VelocityCommand, NavigationState]) -> bool:
    """Say whether the robot stands because of something on the floor."""
    command, state = came
    assert state.mode is Mode.AUTO
    assert (command.v_m_s == 0.0) == ("lies on the floor" in state.message)
    return command.v_m_s == 0.0


@pytest.mark.parametrize(
    "stopped", [SafetyState.STANDBY, SafetyState.EMERGENCY_STOP, SafetyState.FAULT]
)
def test_what_the_robot_has_stopped_for_is_known_when_it_is_armed_again(
    tmp_path: Path, stopped: SafetyState
) -> None:
    robot = Looking(tmp_path)
    robot.arm()
    robot.drive_to(UP_TO_IT + 0.05)
    assert waits(robot.auto())
    for _ in range(2):
        robot.stop(stopped)
        robot.arm()
        assert waits(robot.auto())


def test_a_robot_carried_away_while_disarmed_goes_on_when_it_has_backed_up_and_seen_the_floor(
    tmp_path: Path,
) -> None:
    robot = Looking(tmp_path)
    robot.arm()
    robot.drive_to(UP_TO_IT + 0.05)
    robot.stop(SafetyState.STANDBY)
    robot.plank = False
    robot.arm()
    assert waits(robot.auto())
    robot.drive_to(UP_TO_IT - 0.25)
    assert not waits(robot.auto())


def test_what_passes_before_a_robot_that_is_not_armed_is_not_kept(tmp_path: Path) -> None:
    robot = Looking(tmp_path)
    robot.drive_to(UP_TO_IT)
    robot.plank = False
    robot.arm()
    assert not waits(robot.auto())


@pytest.mark.parametrize("plank", [True, False])
def test_navigation_that_starts_under_way_does_not_drive_over_floor_that_was_below_the_picture(
    tmp_path: Path, plank: bool
) -> None:
    robot = Looking(tmp_path)
    robot.plank = plank
    robot.arm()
    robot.drive_to(UP_TO_IT + 0.05)
    robot.adapter = make_navigation(CONFIG, robot.options)
    assert waits(robot.auto())
    (said,) = robot.adapter.take_notices()
    assert "back it up" in said
    robot.drive_to(UP_TO_IT - 0.25)
    assert not waits(robot.auto())  # the plank, if it is there, is far enough ahead now
    robot.drive_to(UP_TO_IT + 0.05)
    assert waits(robot.auto()) == plank
    assert robot.adapter.take_notices() == []


def test_a_drive_that_restarts_makes_the_floor_unknown(tmp_path: Path) -> None:
    robot = Looking(tmp_path)
    robot.plank = False
    robot.arm()
    assert not waits(robot.auto())
    robot.odom_epoch_ns = robot.now_ns
    robot.stop(SafetyState.FAULT)
    robot.arm()
    assert waits(robot.auto())
    floor, mode = robot.adapter.take_notices()
    assert "what was seen of the floor is forgotten" in floor
    assert mode == "hold: the robot was stopped"


def test_a_robot_that_was_never_armed_begins_with_a_free_floor(tmp_path: Path) -> None:
    robot = Looking(tmp_path)
    robot.plank = False
    robot.odom_epoch_ns = robot.now_ns  # its motors are switched on behind the controller
    robot.step()
    robot.arm()
    assert not waits(robot.auto())
    assert robot.adapter.take_notices() == []


def unseeing(folder: Path) -> Looking:
    """Return an armed robot on a free floor whose camera has given nothing yet."""
    robot = Looking(folder)
    robot.adapter = make_navigation(CONFIG, robot.options)
    robot.plank, robot.late_ns = False, None
    robot.step()
    robot.arm()
    return robot


def test_a_robot_that_counts_on_its_camera_waits_for_the_first_picture(tmp_path: Path) -> None:
    robot = unseeing(tmp_path)
    command, state = robot.auto()
    for _ in range(20 * 30):  # longer than a blocked robot tries
        assert (command.v_m_s, command.omega_rad_s, state.mode) == (0.0, 0.0, Mode.AUTO)
        assert state.message == "waits: the camera has given no picture yet"
        command, state = robot.step()
    robot.late_ns = 0
    command, state = robot.step()
    assert command.v_m_s > 0.0
    assert not state.mission_failed
    assert robot.adapter.take_notices() == [
        "the camera has given no picture yet: the robot waits",
        "the camera gives pictures again",
    ]


def test_it_stops_half_a_second_behind_the_last_picture_and_goes_on_with_the_next(
    tmp_path: Path,
) -> None:
    robot = unseeing(tmp_path)
    robot.late_ns = 0
    assert robot.auto()[0].v_m_s > 0.0
    robot.late_ns = None
    moves = [robot.step()[0].v_m_s > 0.0 for _ in range(20)]
    assert moves == [True] * 10 + [False] * 10
    robot.late_ns = 0
    assert robot.step()[0].v_m_s > 0.0


def test_pictures_of_long_ago_are_none(tmp_path: Path) -> None:
    robot = unseeing(tmp_path)
    robot.late_ns = 1_500_000_000
    assert robot.auto()[0].v_m_s == 0.0


def test_an_operator_drives_without_pictures(tmp_path: Path) -> None:
    robot = unseeing(tmp_path)
    robot.step(Mode.MANUAL)
    robot.now_ns += robot.adapter.period_ns
    sticks = ManualControl(robot.now_ns, robot.now_ns + 10**9, 0.5, 0.0)
    command, _ = robot.adapter.step(robot.control(), None, [sticks], robot.now_ns, [])
    assert command.v_m_s > 0.0
