"""Driving a running robot from beside it: its other end is played here, in step with the clock."""

import time

import msgspec
import pytest
import zmq

from robotctl.app.processes.robot import make_core
from robotctl.app.supervision.remote import RefusedError, RemoteRobot
from robotctl.app.supervision.running_robot import running
from robotctl.cli.mission import status_lines
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import LinkError
from robotctl.messages.control import (
    LoopStatistics,
    NavigationState,
    PositionTarget,
    SafetyState,
    SetMode,
)
from robotctl.messages.mission import (
    AbortMission,
    ExploreTarget,
    GoAhead,
    JumpToItem,
    LoadMission,
    MissionCommand,
    PlaceTarget,
)
from robotctl.messages.mode import Mode
from robotctl.runtime.ipc.topics import Endpoints, Publisher, RequestReceiver, endpoint_directory

STANDBY = make_core(load_robot(find_file("diff_drive")), StackOptions("x", "")).snapshot(
    0, LoopStatistics()
)
ARMED = msgspec.structs.replace(STANDBY, state=SafetyState.ARMED)


class Robot:
    """Control and navigation of a robot, and the clock: it answers whenever somebody waits."""

    def __init__(self, control=ARMED):
        self.context = zmq.Context()
        ends = Endpoints(endpoint_directory("rover"))
        self.publishers = [
            Publisher(self.context, each) for each in (ends.control_state, ends.navigation_state)
        ]
        self.requests = RequestReceiver(
            self.context, ends.navigation_requests, SetMode | PositionTarget | MissionCommand
        )
        self.control, self.time_ns = control, 0
        self.state = NavigationState(0, Mode.HOLD, "", 0, 0, "", False, False, "")
        self.heard = []
        self.obeys, self.began_mission = True, False
        self.after_goal = []
        """States that follow once there is a goal or a mission under way, as changes."""
        self.mute = set()
        """Names of the processes that have stopped."""
        self.listener = None
        """Who must have heard a state before the next one follows, and before time passes."""

    def now_ns(self):
        return self.time_ns

    def sleep_until(self, _deadline_ns):
        time.sleep(0.001)  # sockets connect and carry in real time
        if self.mute:
            self.time_ns += 100_000_000
        if self.listener.control is not None and self.listener.navigation == self.state:
            self.time_ns += 2_000_000
            self._answer()
        names, messages = ("control", "navigation"), (self.control, self.state)
        for name, publisher, message in zip(names, self.publishers, messages, strict=True):
            if name not in self.mute:
                stamped = {} if not self.mute else {"stamp_ns": self.time_ns}
                publisher.send(msgspec.structs.replace(message, **stamped))

    def _answer(self):
        for request in self.requests.receive():
            self.heard.append(request)
            if not self.obeys:
                self.change(message="refused: no")
            elif isinstance(request, SetMode):
                self.change(mode=request.mode, mission_failed=False)
                self.began_mission |= request.mode is Mode.AUTO
            elif isinstance(request, LoadMission | AbortMission):
                self.change(
                    mission_runs=self.state.mission_runs + 1,
                    mission_commands=self.state.mission_commands + 1,
                    items=3,
                )
            elif isinstance(request, GoAhead | JumpToItem):
                self.change(mission_commands=self.state.mission_commands + 1, waits=False)
            else:
                self.change(goals=self.state.goals + 1, goal_reached=None, message="2.0 m to go")
        is_begun = self.state.goals or self.began_mission
        if is_begun and self.after_goal:
            self.change(**self.after_goal.pop(0))

    def change(self, **what):
        self.state = msgspec.structs.replace(self.state, **what)


class Beside(RemoteRobot):
    """What is tested, beside a robot that waits until it was heard."""

    def __init__(self, robot):
        super().__init__(clock=robot)
        robot.listener = self


@pytest.fixture
def make_robot(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    made = []

    def make(*args):
        made.append(Robot(*args))
        return made[-1]

    yield make
    for robot in made:
        robot.context.destroy(linger=0)


def test_a_goal_is_asked_for_in_guided_and_followed_to_its_end(make_robot):
    robot = make_robot()
    robot.after_goal = [
        {},
        {"message": "1.0 m to go"},
        {"goal_reached": True, "message": "arrived"},
    ]
    with Beside(robot) as remote:
        states = list(remote.goto(1.0, -2.0, 0.5))
    mode, goal = robot.heard
    assert mode.mode is Mode.GUIDED
    assert (goal.x_m, goal.y_m, goal.heading_rad) == (1.0, -2.0, 0.5)
    assert all(state.goal_reached is None for state in states[:-1])
    assert (states[-1].goal_reached, states[-1].message) == (True, "arrived")


def test_a_robot_that_gives_up_says_why(make_robot):
    robot = make_robot()
    robot.after_goal = [{"goal_reached": False, "message": "gave up after 5 tries: closed"}]
    with Beside(robot) as remote:
        *_, last = remote.goto(1.0, -2.0)
    assert last.goal_reached is False
    assert last.message == "gave up after 5 tries: closed"


@pytest.mark.parametrize("other", [{"mode": Mode.HOLD}, {"goals": 2}])
def test_a_robot_that_somebody_else_takes_over_is_left_to_him(make_robot, other):
    robot = make_robot()
    robot.after_goal = [{}, {"message": "taken", **other}]
    with (
        Beside(robot) as remote,
        pytest.raises(RefusedError, match="given up for something else: taken"),
    ):
        list(remote.goto(1.0, -2.0))
    assert len(robot.heard) == 2


def test_an_unarmed_robot_is_asked_for_nothing(make_robot):
    robot = make_robot(STANDBY)
    with (
        Beside(robot) as remote,
        pytest.raises(RefusedError, match=r"not armed \(.*\); arm it first"),
    ):
        list(remote.goto(1.0, -2.0))
    assert robot.heard == []


def test_a_refusal_is_told_in_the_robots_words(make_robot):
    robot = make_robot()
    robot.obeys = False
    with (
        Beside(robot) as remote,
        pytest.raises(RefusedError, match="refused: no"),
    ):
        list(remote.goto(1.0, -2.0))


def test_hold_is_waited_for(make_robot):
    robot = make_robot()
    robot.change(mode=Mode.GUIDED)
    with Beside(robot) as remote:
        remote.hold()
        assert remote.navigation.mode is Mode.HOLD
    assert [each.mode for each in robot.heard] == [Mode.HOLD]


def test_without_a_name_it_is_the_only_one_that_runs(make_robot):
    with pytest.raises(LinkError, match="no robot: none runs"):
        running("")
    make_robot()
    assert running("").control_state == running("rover").control_state


def test_exploring_is_followed_as_a_goal_is(make_robot):
    robot = make_robot()
    robot.after_goal = [{}, {"goal_reached": True, "message": "the map is complete"}]
    with Beside(robot) as remote:
        *_, last = remote.explore()
    assert [type(each) for each in robot.heard] == [SetMode, ExploreTarget]
    assert last.goal_reached


def test_a_place_is_asked_for_by_its_name(make_robot):
    robot = make_robot()
    robot.after_goal = [{}, {"goal_reached": True, "message": "in den"}]
    with Beside(robot) as remote:
        *_, last = remote.goto_place("den", "hall")
    assert [type(each) for each in robot.heard] == [SetMode, PlaceTarget]
    assert (robot.heard[1].place, robot.heard[1].start) == ("den", "hall")
    assert last.goal_reached


def test_a_mission_is_loaded_driven_and_followed_through_a_pause_to_its_end(make_robot):
    robot = make_robot()
    robot.after_goal = [
        {"message": "item 1"},
        {"mode": Mode.HOLD},
        {"mode": Mode.AUTO},
        {"mission_completed": True},
    ]
    with Beside(robot) as remote:
        *_, last = remote.run_mission("/tmp/m.toml", b"name = 1")
    load, mode = robot.heard
    assert (load.file, load.content) == ("/tmp/m.toml", b"name = 1")
    assert mode.mode is Mode.AUTO
    assert last.mission_completed


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"mission_runs": 7}, "another mission, or aborted"),
        ({"mode": Mode.HOLD, "held": True, "message": "hold: the robot was stopped"}, "stopped"),
        ({"mode": Mode.MANUAL}, "interrupted in mode MANUAL"),
    ],
)
def test_a_mission_that_somebody_else_ends_is_left_to_him(make_robot, other, told):
    robot = make_robot()
    robot.after_goal = [{}, other]
    with Beside(robot) as remote, pytest.raises(RefusedError, match=told):
        list(remote.run_mission("/tmp/m.toml", b""))


def test_resuming_is_what_the_mission_needs(make_robot):
    robot = make_robot()
    with Beside(robot) as remote:

        def see(**what):
            robot.change(**what)
            remote._await(lambda: remote.navigation == robot.state, lambda: "not heard")

        remote.resume()
        see(waits=True)
        remote.resume()
        see(mission_failed=True)
        remote.resume()
        see()
        with pytest.raises(RefusedError, match="is under way"):
            remote.resume()
        see(mission_completed=True)
        with pytest.raises(RefusedError, match="is completed"):
            remote.resume()
        with pytest.raises(RefusedError, match="no mission is under way"):
            remote.pause()
        remote.abort()
        remote.jump("home")
    kinds = [type(each) for each in robot.heard]
    assert kinds == [SetMode, GoAhead, SetMode, AbortMission, JumpToItem]
    assert robot.heard[-1].item == "home"


def test_the_status_of_a_mission_is_told_in_lines():
    state = NavigationState(
        0, Mode.AUTO, "rounds", 2, 7, "kitchen", False, False, "item 3: 1.2 m to go",
        loops="item 5 (repeat): 2 of 3", trouble="item 1 (goto): blocked", waits=True,
    )  # fmt: skip
    assert status_lines(state) == [
        "mission: rounds",
        "state: waits for the go-ahead: `robotctl mission resume`",
        'item: 3 of 7 "kitchen"',
        "robot: item 3: 1.2 m to go",
        "loops: item 5 (repeat): 2 of 3",
        "trouble: item 1 (goto): blocked",
    ]
    held = msgspec.structs.replace(state, mode=Mode.HOLD, waits=False)
    assert "state: not under way: mode HOLD" in status_lines(held)
    assert status_lines(msgspec.structs.replace(state, items=0)) == ["no mission is loaded"]


@pytest.mark.parametrize("mute", ["control", "navigation"])
def test_who_is_silent_is_named_with_its_age_and_given_up_in_the_end(make_robot, mute):
    robot = make_robot()
    with Beside(robot) as remote:
        driving = remote.goto(1.0, 2.0)
        next(driving)
        assert remote.silence == ""
        robot.mute = {mute}
        silences = []
        with pytest.raises(RefusedError, match=rf"{mute} silent for 10\.\d s; the robot stops"):
            silences.extend(remote.silence for _ in driving)
    assert silences[-1].startswith(f"{mute} silent for ")
    assert sum(each == "" for each in silences) <= 3


@pytest.mark.parametrize(
    ("mute", "words"),
    [
        ({"control"}, "the robot's control is not heard"),
        ({"navigation"}, "the robot's navigation is not heard"),
        ({"control", "navigation"}, "the robot's control and navigation are not heard"),
    ],
)
def test_who_is_not_heard_at_all_is_named(make_robot, mute, words):
    robot = make_robot()
    robot.mute = mute
    with pytest.raises(RefusedError, match=words), Beside(robot):
        pass
