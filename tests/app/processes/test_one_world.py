"""A jump of `T_world_odom` by 2 m: all tell the same pose, and the robot goes on to its goal."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.progress import ProgressKeeper, load_progress, progress_file
from robotctl.app.processes.robot import make_core
from robotctl.app.scoring.journey_score import JourneyScore
from robotctl.app.scoring.map_truth import MapTruth
from robotctl.app.scoring.run_score import RunScore
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.control.limiter import TwistLimiter
from robotctl.logs.mcap.scene import Scene
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import (
    ControlState,
    LoopStatistics,
    Mode,
    NavigationRequest,
    NavigationState,
    PositionTarget,
    SafetyState,
    SetMode,
)
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.mavlink_port import Message, Peer
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.wall_map import WallMap

CONFIG = load_robot(
    find_file("diff_drive"), ('localisation.method="mcl"', 'localisation.map="hall.toml"')
)
STATE = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
MISSION = """
name = "ahead"
world = "flat"
start = { x_m = 0.0, y_m = 0.0 }
[[item]]
kind = "drive"
waypoints = [[0.0, 0.0], [6.0, 0.0]]
"""
STEP_S = 1.0 / CONFIG.navigation.rate_hz
T_FIRST = SE2(3.0, -2.0, 0.5)
"""Where the odometry's frame lies: the robot starts at the origin of `world` all the same."""
JUMPS = [SE2(2.0, 0.0, 0.0), SE2(0.0, 2.0, 0.0), SE2(-2.0, 0.0, 0.0), SE2(1.2, -1.6, 0.3)]


class Links:
    """Links on which only what is sent counts."""

    count = 1

    def __init__(self) -> None:
        self.position: tuple[float, float] | None = None
        self.resets = 0

    def poll(self, _now_ns: int, _timeout_s: float = 0.0) -> list[Message]:
        """Bring nothing."""
        return []

    def peers(self) -> tuple[Peer, ...]:
        """Name one ground station."""
        return (Peer(0, 0),)

    def broadcast(self, message: Message, _peers: object = None) -> None:
        """Keep the position, in our axes."""
        if message.get_type() == "LOCAL_POSITION_NED":
            self.position = message.y, message.x
        if message.get_type() == "ODOMETRY":
            self.resets = message.reset_counter

    def reply(self, _message: Message, _peer: object) -> None:
        """Drop it."""

    def flush(self) -> None:
        """Do nothing."""

    def status(self) -> tuple[()]:
        """Tell nothing."""
        return ()

    def close(self) -> None:
        """Do nothing."""


class World:
    """A robot that moves as it is told, a localiser that may jump, and all who tell its pose."""

    def __init__(self, folder: Path) -> None:
        (folder / "mission.toml").write_text(MISSION)
        self.options = StackOptions(
            "robot", "", mission=str(folder / "mission.toml"), state=str(folder / "s"), run="one"
        )
        self.now_ns = 10**12
        self.odom_epoch_ns = self.now_ns
        self.T_world_odom = T_FIRST
        self.odometry = T_FIRST.inverse()
        self.status = LocalisationStatus.LOCALISED
        self.epoch_ns = self.now_ns
        self.limiter = TwistLimiter(CONFIG.limits)
        self.v_m_s = self.omega_rad_s = 0.0
        self.links = Links()
        rates = {"position_hz": 100.0, "odometry_hz": 100.0}
        config = msgspec.convert({"rates": rates}, MavlinkConfig)
        self.telemetry = Telemetry(config, TelemetryRobot("robot", has_localiser=True), self.links)
        for ago_ms in range(500, 0, -20):  # the streams begin one after the other
            self.telemetry.step(self.now_ns - ago_ms * 1_000_000, [])
        self.file = progress_file(Path(self.options.state))
        self.keeper = ProgressKeeper(self.file, self.options, None, localised=True)
        self.scene = Scene(has_localiser=True)
        walls = WallMap(np.array([[-99.0, -99.0, 99.0, -99.0]]))
        self.score = RunScore(
            MapTruth(walls, lambda: walls),
            JourneyScore([[np.eye(3, 2)]], walls.segments),
            has_localiser=True,
            is_recorded=False,
        )
        self.state: NavigationState | None = None
        self.navigate()

    def navigate(self) -> None:
        """Start the navigator, and see what pose it steers by."""
        self.adapter = make_navigation(CONFIG, self.options)
        step = self.adapter.navigator.step
        steers_by = self.steers_by = []  # type: list[tuple[SE2, bool]]

        def watched(inputs, now_ns):  # type: ignore[no-untyped-def]
            steers_by.append((inputs.pose, inputs.localised))
            return step(inputs, now_ns)

        self.adapter.navigator.step = watched  # type: ignore[method-assign]

    @property
    def truth(self) -> SE2:
        """Where the robot is in the world."""
        return self.T_world_odom @ self.odometry

    def jump(self, by: SE2) -> None:
        """Find the robot elsewhere: the odometry stays what it is."""
        self.T_world_odom = by @ self.T_world_odom
        self.epoch_ns = self.now_ns

    def control(self) -> ControlState:
        """Return the state of control."""
        return msgspec.structs.replace(
            STATE,
            stamp_ns=self.now_ns,
            state=SafetyState.DRIVING,
            armings=1,
            x_m=self.odometry.x_m,
            y_m=self.odometry.y_m,
            theta_rad=self.odometry.theta_rad,
            odom_epoch_ns=self.odom_epoch_ns,
            v_m_s=self.v_m_s,
            omega_rad_s=self.omega_rad_s,
            vy_m_s=0.0,
            sonar_m=(math.inf,) * len(CONFIG.sonar),
            sonar_stamp_ns=(self.now_ns,) * len(CONFIG.sonar),
        )

    def belief(self) -> LocalisationState:
        """Return what the localiser says; while it is unsure, its place is far off."""
        T = self.T_world_odom
        if self.status is not LocalisationStatus.LOCALISED:
            T = SE2(50.0, 50.0, 2.0) @ T
        return LocalisationState(
            self.now_ns, "mcl", self.status, T.x_m, T.y_m, T.theta_rad, (0.01,) * 6,
            odom_epoch_ns=self.odom_epoch_ns, epoch_ns=self.epoch_ns,
        )  # fmt: skip

    def step(self, *requests: NavigationRequest) -> None:
        """Let all take one step, and compare what they tell."""
        self.now_ns += round(STEP_S * 1e9)
        control, belief = self.control(), self.belief()
        command, self.state = self.adapter.step(control, belief, requests, self.now_ns)
        self.telemetry.step(self.now_ns, [belief, control])
        self.keeper.step([belief, control, self.state], self.now_ns)
        self.keeper.close()
        self.scene.localise(belief)
        self.score.localisation(belief)
        told = {"navigator": self.steers_by[-1][0], "score": self.score.control(control)}
        saved, _ = load_progress(self.options)
        assert saved is not None
        told["stored progress"] = SE2(saved.x_m, saved.y_m, saved.theta_rad)
        _, shown = self.scene.frames(self.now_ns, control)
        assert shown is not None
        told["log"] = SE2(shown.pose.position.x, shown.pose.position.y, shown.theta_rad)
        assert self.links.position is not None
        told["MAVLink"] = SE2(*self.links.position, self.truth.theta_rad)
        for name, pose in told.items():
            assert pose is not None, name
            off_m = math.hypot(pose.x_m - self.truth.x_m, pose.y_m - self.truth.y_m)
            off_rad = math.remainder(pose.theta_rad - self.truth.theta_rad, math.tau)
            assert (name, off_m) == (name, pytest.approx(0.0, abs=1e-5))
            assert (name, off_rad) == (name, pytest.approx(0.0, abs=1e-6))
        self.drive(command.v_m_s, command.omega_rad_s)

    def drive(self, v_m_s: float, omega_rad_s: float) -> None:
        """Move as the control process lets the robot, without a jump of velocity."""
        was_m_s = self.v_m_s
        twist = self.limiter.step(Twist(v_m_s, omega_rad_s), STEP_S)
        self.v_m_s, self.omega_rad_s = twist.v_m_s, twist.omega_rad_s
        most = CONFIG.limits.a_max_m_s2 * STEP_S
        assert abs(self.v_m_s - was_m_s) <= most + 1e-9
        self.odometry = self.odometry @ SE2.exp(self.v_m_s * STEP_S, 0.0, self.omega_rad_s * STEP_S)

    def run(self, until_m: float = math.inf, seconds: float = 60.0) -> None:
        """Step until the robot has driven so far, or has nothing more to do."""
        driven_m = 0.0
        for _ in range(round(seconds / STEP_S)):
            self.step()
            driven_m += abs(self.v_m_s) * STEP_S
            if driven_m >= until_m:
                return
            assert self.state is not None
            if self.state.mission_completed or self.state.message == "arrived":
                return

    def off_m(self, x_m: float, y_m: float) -> float:
        """Return how far it is from a point of the world [m]."""
        return math.hypot(self.truth.x_m - x_m, self.truth.y_m - y_m)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


@pytest.mark.parametrize("by", JUMPS)
def test_a_jump_in_the_middle_of_a_path(world: World, by: SE2) -> None:
    world.step()
    world.step(SetMode(world.now_ns, Mode.AUTO))
    world.run(until_m=2.0)
    world.jump(by)
    world.run()
    assert world.state is not None
    assert world.state.mission_completed, world.state.message
    assert world.off_m(6.0, 0.0) < 0.3


@pytest.mark.parametrize("by", JUMPS)
def test_a_jump_on_the_way_to_a_guided_position(world: World, by: SE2) -> None:
    world.step()
    world.step(SetMode(world.now_ns, Mode.GUIDED))
    world.step(PositionTarget(world.now_ns, 5.0, 3.0))
    world.run(until_m=2.0)
    world.jump(by)
    world.run()
    assert world.state is not None
    assert world.state.message == "arrived"
    assert world.off_m(5.0, 3.0) < 0.3


@pytest.mark.parametrize("by", JUMPS)
def test_a_jump_on_the_way_home(world: World, by: SE2) -> None:
    world.step()
    world.step(SetMode(world.now_ns, Mode.GUIDED))
    world.step(PositionTarget(world.now_ns, 5.0, 0.0))
    world.run()
    world.step(SetMode(world.now_ns, Mode.RTL))
    world.run(until_m=2.5)
    world.jump(by)
    world.run()
    assert world.state is not None
    assert world.off_m(0.0, 0.0) < 0.3, world.state.message


@pytest.mark.parametrize("by", JUMPS)
def test_a_jump_at_a_restart_of_navigation(world: World, by: SE2) -> None:
    world.step()
    world.step(SetMode(world.now_ns, Mode.AUTO))
    world.run(until_m=2.0)
    assert world.state is not None
    item, item_s_m = world.state.item, world.state.item_s_m
    world.jump(by)
    world.navigate()
    world.adapter.navigator.auto.resume(item, item_s_m)
    world.step()
    world.step(SetMode(world.now_ns, Mode.AUTO))
    world.run()
    assert world.state is not None
    assert world.state.mission_completed, world.state.message
    assert world.off_m(6.0, 0.0) < 0.3


def test_a_restart_of_control_in_the_middle_of_a_path(world: World) -> None:
    """Its odometry begins anew elsewhere; what was said of the one before does not count for it."""
    world.step()
    world.step(SetMode(world.now_ns, Mode.AUTO))
    world.run(until_m=2.0)
    there = world.truth
    world.odom_epoch_ns = world.now_ns
    assert world.score.control(world.control()) is None
    world.odometry = SE2(7.0, 8.0, 2.0)
    world.T_world_odom = there @ world.odometry.inverse()
    world.run()
    assert world.state is not None
    assert world.off_m(6.0, 0.0) < 0.3, world.state.message


@pytest.mark.parametrize("status", [LocalisationStatus.SEARCHING, LocalisationStatus.LOST])
def test_while_the_localiser_is_unsure_all_go_on_from_the_place_known_last(
    world: World, status: LocalisationStatus
) -> None:
    world.step()
    world.step(SetMode(world.now_ns, Mode.AUTO))
    world.run(until_m=1.0)
    world.status = status
    for _ in range(100):
        world.step()
        assert not world.steers_by[-1][1]


def test_a_ground_station_hears_of_each_jump_once(world: World) -> None:
    world.step()
    before = world.links.resets
    for count, by in enumerate(JUMPS, before + 1):
        world.jump(by)
        for _ in range(5):
            world.step()
        assert world.links.resets == count
