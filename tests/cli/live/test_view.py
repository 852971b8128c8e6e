"""What a person watches during a run: each figure in its place, and none that nobody measures."""

from __future__ import annotations

import dataclasses
import io
import math
import re

import msgspec
import numpy as np
import pytest
from rich.console import Console

from robotctl.app.processes.robot import make_core
from robotctl.app.simulation.run_status import RunStatus
from robotctl.cli.live.view import LineView, LiveView
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import (
    BatteryFeedback,
    ControlState,
    LoopStatistics,
    NavigationState,
    SafetyState,
)
from robotctl.messages.mode import Mode
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap

CONFIG = load_robot(find_file("diff_drive"))
SILENT = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
MOVING = msgspec.structs.replace(
    SILENT,
    state=SafetyState.DRIVING,
    x_m=1.25,
    y_m=2.0,
    theta_rad=math.pi / 2,
    v_m_s=0.4,
    omega_rad_s=-0.25,
    wheel_rad_s=(7.5, 8.5),
    sonar_m=(1.5, math.inf, *(math.nan,) * (len(CONFIG.sonar) - 2)),
)
ROOM = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], dtype=float)


def pose_of(control: ControlState | None) -> SE2 | None:
    return None if control is None else control.T_odom_base


def printed(control: ControlState | None) -> str:
    console = Console(file=io.StringIO(), width=120)
    with LineView(console, CONFIG, ("CAN vcan0",)) as view:
        view.update(RunStatus(6.0, control, pose=pose_of(control), lines=["armed"]))
        view.update(RunStatus(7.0, control, pose=pose_of(control)))
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


def screen(control: ControlState | None) -> str:
    console = Console(file=io.StringIO(), width=140, height=50)
    view = LiveView(console, CONFIG, WallMap(ROOM), ("CAN vcan0",))
    console.print(view.screen(RunStatus(6.0, control, pose=pose_of(control))))
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


def test_a_line_tells_state_pose_and_velocity_and_comes_each_five_seconds() -> None:
    connect, notice, line = printed(MOVING).splitlines()
    assert connect == "    0.0 s  connect: CAN vcan0"
    assert notice == "    6.0 s  armed"
    assert line.startswith("    6.0 s  DRIVING  x 1.25 m y 2.00 m 90° v 0.40 m/s lag p99 0 µs")
    assert len(printed(None).splitlines()) == 2


def test_the_screen_tells_each_wheel_and_each_sonar() -> None:
    lines = screen(MOVING).splitlines()

    def after(name: str) -> list[str]:
        """Return the words that follow a name where it first stands at the side of the map."""
        return next(line.split(name, 1)[1] for line in lines if f" {name} " in line).split()

    assert "DRIVING" in lines[0]
    assert after("velocity")[:4] == ["0.40", "m/s", "(ref", "0.00)"]
    assert after("velocity")[4:6] == ["-0.25", "rad/s"]
    assert after("left")[:2] == ["7.50", "rad/s"]
    assert after("right")[:2] == ["8.50", "rad/s"]
    assert after("front")[:2] == ["1.50", "m"]
    assert after("front_left") == ["no", "echo"]
    assert after("rear") == ["-"]
    assert any("↑" in line for line in lines)


@pytest.mark.parametrize("show", [printed, screen])
def test_what_nobody_measures_is_a_dash(show: object) -> None:
    assert callable(show)
    text = show(SILENT)
    assert "nan" not in text
    assert "- m/s" in text


def test_a_screen_without_control_says_for_whom_it_waits() -> None:
    assert "waiting for the control process" in screen(None)


def test_a_place_that_is_not_known_yet_is_no_figure() -> None:
    console = Console(file=io.StringIO(), width=140, height=50)
    progress = RunStatus(6.0, MOVING)
    console.print(LiveView(console, CONFIG, WallMap(ROOM), ()).screen(progress))
    with LineView(console, CONFIG, ()) as view:
        view.update(progress)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "x - m  y - m  -°" in shown
    assert "x - m y - m -°" in shown
    assert "↑" not in shown


def test_the_walls_stay_and_what_moved_does_not() -> None:
    console = Console(file=io.StringIO(), width=140, height=50)
    view = LiveView(console, CONFIG, WallMap(ROOM), ())
    shown = []
    for x_m in (1.25, 2.5):
        control = msgspec.structs.replace(MOVING, x_m=x_m)
        console.print(view.screen(RunStatus(6.0, control, pose=pose_of(control))))
        shown.append(console.file.getvalue())  # type: ignore[attr-defined]
    first, second = shown[0], shown[1].removeprefix(shown[0])
    assert [text.count("↑") for text in (first, second)] == [1, 1]
    corners = [
        line.index("⣇") for text in (first, second) for line in text.splitlines() if "⣇" in line
    ]
    assert len(corners) == 2
    assert corners[0] == corners[1]


NAVIGATION = NavigationState(
    stamp_ns=0,
    mode=Mode.AUTO,
    mission="patrol",
    item=1,
    items=5,
    item_name="south wall",
    mission_completed=False,
    mission_failed=False,
    message='item 2 "south wall": 3.2 m to go',
)
CHARGED = msgspec.structs.replace(
    MOVING, battery=BatteryFeedback(0, 24.5, 0.0, 0.87, 25.0, low=False, critical=False)
)
CLEAR = "\x1b[2J"
NOTICES = [
    f"notice {number} of a robot that has a lot to tell, more than a line" for number in range(9)
]


def shown(
    control: ControlState, width: int, height: int, *, helps: bool = False, **known: object
) -> list[str]:
    """Return the lines of the screen of a terminal."""
    console = Console(file=io.StringIO(), width=width, height=height)
    view = LiveView(console, CONFIG, WallMap(ROOM), ("CAN vcan0",), keys=True)
    known = {"pose": pose_of(control), "lines": list(NOTICES)} | known
    progress = RunStatus(6.0, control, NAVIGATION, **known)  # type: ignore[arg-type]
    view.update(progress)
    if helps:
        view.help()
    console = Console(file=io.StringIO(), width=width, height=height)
    console.print(view.screen(progress))
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined, no-any-return]


SIZES = [(80, 24), (80, 25), (132, 43), (200, 60), (60, 20), (40, 12), (250, 24)]


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("helps", [False, True])
def test_a_screen_fits_its_terminal_and_what_counts_comes_first(
    width: int, height: int, helps: bool
) -> None:
    lines = shown(CHARGED, width, height, helps=helps)
    assert len(lines) <= height - 1 or (helps and height < 20)
    assert all(len(line) <= width for line in lines)
    assert "DRIVING" in lines[0]
    assert "to go" in lines[1]
    assert "x 1.25 m  y 2.00 m  90°" in lines[2]
    assert ("battery 24.5 V 87 %" in lines[2]) == (width >= 60)
    assert lines[3].startswith("Space or e: EMERGENCY STOP  a arm")
    has_map = any("─ map ─" in line for line in lines)
    assert has_map == (not helps and height > 15)


def test_at_80_by_24_there_are_a_map_the_names_of_the_keys_and_the_last_notices() -> None:
    lines = shown(CHARGED, 80, 24)
    assert lines[3].endswith("m mission  h hold  r home  ? help")
    framed = [line for line in lines if line.startswith("│")]
    assert len(framed) >= 10
    assert any("↑" in line for line in framed)
    assert any("front_left" in line for line in framed)
    assert [NOTICES[number][:8] in lines[-3 + index] for index, number in enumerate((6, 7, 8))]
    assert "notice 5" not in "\n".join(lines)


@pytest.mark.parametrize(
    ("state", "what"),
    [
        (SafetyState.STANDBY, "a arms it"),
        (SafetyState.FAULT, "a arms it again, m then resumes the mission, Ctrl-C ends"),
        (SafetyState.EMERGENCY_STOP, "a arms it again, m then resumes the mission"),
        (SafetyState.ARMED, ""),
    ],
)
def test_a_robot_that_stands_says_why_and_what_to_do(state: SafetyState, what: str) -> None:
    standing = msgspec.structs.replace(CHARGED, state=state, reason="a cable is off")
    lines = shown(standing, 80, 24)
    if what:
        assert "a cable is off" in lines[1]
        assert lines[2].startswith(what)
    else:
        assert lines[2].startswith("x 1.25")


def test_the_factor_is_shown_where_the_computer_does_not_keep_up() -> None:
    assert "0.83 × real time" in shown(CHARGED, 80, 24, real_time_factor=0.831)[2]
    assert "real time" not in shown(CHARGED, 80, 24, real_time_factor=0.999)[2]


MS = 1_000_000
ANSI = re.compile(r"\x1b\[[0-9;]*m")
NAVIGATING = NavigationState(0, Mode.AUTO, "patrol", 1, 4, "square", False, False, "3.1 m to go")
NOW_NS = 10_000 * MS


def run_status(control_ms: float = 0.0, navigation_ms: float = 0.0, **more: object) -> RunStatus:
    """Return the status of a run whose states have such ages."""
    control = msgspec.structs.replace(MOVING, stamp_ns=NOW_NS - round(control_ms * MS))
    navigation = msgspec.structs.replace(NAVIGATING, stamp_ns=NOW_NS - round(navigation_ms * MS))
    status = RunStatus(6.0, control, navigation, pose=pose_of(control), now_ns=NOW_NS)
    return dataclasses.replace(status, **more)  # type: ignore[arg-type]


def coloured(status: RunStatus) -> list[str]:
    console = Console(file=io.StringIO(), width=140, height=50, force_terminal=True)
    view = LiveView(console, CONFIG, WallMap(ROOM), (), keys=True)
    console.print(view.screen(status))
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined, no-any-return]


def is_grey(line: str, words: str) -> bool:
    """Return whether some words of a line are dim."""
    assert words in ANSI.sub("", line), line
    return re.search(rf"\x1b\[2m[^\x1b]*{re.escape(words)}", line) is not None


def test_what_is_fresh_is_not_grey() -> None:
    first, message, *_ = coloured(run_status(59.0, 149.0))
    assert not is_grey(first, "DRIVING")
    assert not is_grey(first, "AUTO")
    assert not is_grey(message, "3.1 m to go")
    assert "silent" not in first


def test_what_control_said_three_periods_ago_is_grey_with_its_age() -> None:
    lines = coloured(run_status(1234.0))
    assert "control silent for 1.2 s" in lines[0]
    assert is_grey(lines[0], "DRIVING")
    assert not is_grey(lines[0], "AUTO")
    for words in ("0.40 m/s   battery", "7.50 rad/s", "no echo"):
        assert is_grey(next(line for line in lines if words in ANSI.sub("", line)), words)
    assert any("\x1b[2m↑" in line for line in lines)


def test_dead_control_is_shown_as_such_at_once() -> None:
    first, *_ = coloured(run_status(10.0, control_phase="waiting to be restarted"))
    assert "control waiting to be restarted" in first
    assert is_grey(first, "DRIVING")


def test_silent_navigation_is_grey_and_control_is_not() -> None:
    first, message, *_ = coloured(run_status(0.0, 800.0))
    assert "navigation silent for 0.8 s" in first
    assert is_grey(first, "AUTO")
    assert not is_grey(first, "DRIVING")
    assert is_grey(message, "3.1 m to go")


def test_nothing_is_proposed_to_an_operator_that_silent_control_could_not_do() -> None:
    latched = msgspec.structs.replace(MOVING, state=SafetyState.FAULT, stamp_ns=NOW_NS)
    assert any("arms it again" in line for line in coloured(run_status(0.0, control=latched)))
    old = msgspec.structs.replace(latched, stamp_ns=NOW_NS - 1000 * MS)
    assert not any("arms it again" in line for line in coloured(run_status(0.0, control=old)))


def test_lines_say_who_falls_silent_and_when_all_are_heard_again() -> None:
    console = Console(file=io.StringIO(), width=120)
    with LineView(console, CONFIG, ()) as view:
        for age_ms in (0.0, 100.0, 510.0, 560.0, 10.0):
            view.update(run_status(age_ms))
        view.update(run_status(control_phase="waiting to be restarted"))
    lines = [line.partition(" s  ")[2] for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    assert lines[1:] == [
        "control silent for 0.5 s",
        "all are heard again",
        "control waiting to be restarted",
    ]


CONNECTIONS = (
    "MAVLink udpout:127.0.0.1:14550",
    "MAVLink tcpin:127.0.0.1:5760",
    "CAN -i simcan -c simcan0",
)


@pytest.mark.parametrize(("width", "height"), [(80, 24), (60, 20), (200, 50)])
def test_what_others_have_to_type_to_connect_is_whole(width: int, height: int) -> None:
    console = Console(file=io.StringIO(), width=width, height=height)
    view = LiveView(console, CONFIG, WallMap(ROOM), CONNECTIONS)
    console.print(view.screen(RunStatus(6.0, CHARGED, NAVIGATION, pose=CHARGED.T_odom_base)))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) <= height - 1
    for each in CONNECTIONS:
        assert any(each in line for line in lines)


def test_a_terminal_of_another_size_is_cleared_first() -> None:
    file = io.StringIO()
    console = Console(file=file, width=120, height=40, force_terminal=True)
    progress = RunStatus(6.0, CHARGED, NAVIGATION, pose=CHARGED.T_odom_base)
    with LiveView(console, CONFIG, WallMap(ROOM), CONNECTIONS) as view:
        view.update(progress)
        assert CLEAR not in file.getvalue()
        console.width = 70
        file.truncate(0)
        view.update(progress)
        _, _, after = file.getvalue().partition(CLEAR)
        assert "DRIVING" in after
        assert "\x1b[1A" not in after  # nothing of the old screen is gone back over
        progress.elapsed_s = 7.0
        file.truncate(0)
        view.update(progress)
        assert CLEAR not in file.getvalue()


def test_before_navigation_is_there_nobody_is_told_to_arm() -> None:
    standing = msgspec.structs.replace(CHARGED, state=SafetyState.STANDBY)
    console = Console(file=io.StringIO(), width=80, height=24)
    view = LiveView(console, CONFIG, WallMap(ROOM), CONNECTIONS, keys=True)
    console.print(view.screen(RunStatus(6.0, standing, None)))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "a arms it" not in text
    assert "navigation starts; then the robot is armed" in text
