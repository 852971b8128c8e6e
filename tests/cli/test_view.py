"""What a person watches during a run: each figure in its place, and none that nobody measures."""

from __future__ import annotations

import io
import math

import msgspec
import numpy as np
import pytest
from rich.console import Console

from robotctl.app.config import find_file, load_robot
from robotctl.app.options import StackOptions
from robotctl.app.robot import make_core
from robotctl.app.sim import Progress
from robotctl.cli.view import LineView, LiveView
from robotctl.model.wall_map import WallMap
from robotctl.runtime.messages import ControlState, LoopStatistics, SafetyState

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


def printed(control: ControlState | None) -> str:
    console = Console(file=io.StringIO(), width=120)
    with LineView(console, CONFIG, ("CAN vcan0",)) as view:
        view.update(Progress(6.0, control, lines=["armed"]))
        view.update(Progress(7.0, control))
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


def screen(control: ControlState | None) -> str:
    console = Console(file=io.StringIO(), width=140)
    view = LiveView(console, CONFIG, WallMap(ROOM), ("CAN vcan0",))
    console.print(view.screen(Progress(6.0, control)))
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


def test_the_walls_stay_and_what_moved_does_not() -> None:
    console = Console(file=io.StringIO(), width=140)
    view = LiveView(console, CONFIG, WallMap(ROOM), ())
    shown = []
    for x_m in (1.25, 2.5):
        control = msgspec.structs.replace(MOVING, x_m=x_m)
        console.print(view.screen(Progress(6.0, control)))
        shown.append(console.file.getvalue())  # type: ignore[attr-defined]
    first, second = shown[0], shown[1].removeprefix(shown[0])
    assert [text.count("↑") for text in (first, second)] == [1, 1]
    corners = [
        line.index("⣇") for text in (first, second) for line in text.splitlines() if "⣇" in line
    ]
    assert len(corners) == 2
    assert corners[0] == corners[1]
