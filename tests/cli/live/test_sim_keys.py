"""What the keys of a simulated run ask for."""

import pytest

from robotctl.cli.live.sim_keys import BRIEF, HELP, obey
from robotctl.messages.mode import Mode


class Robot:
    """Notes what it is asked for, as does its view."""

    def __init__(self) -> None:
        self.asked: list[object] = []

    def emergency_key(self) -> None:
        self.asked.append("stop")

    def arm(self, *, arm: bool) -> None:
        self.asked.append(arm)

    def set_mode(self, mode: Mode) -> None:
        self.asked.append(mode)

    def help(self) -> None:
        self.asked.append("help")


@pytest.mark.parametrize(
    ("pressed", "asked"),
    [
        ("", []),
        ("xyz\n", []),
        ("\x1b[A\x1b[D", []),  # arrows
        ("\x1bOA\x1b[1;5D\x1b[15~\x1bm", []),  # arrow and function keys, Alt-m
        ("\x1b[Aa", [True]),
        (" ", ["stop"]),
        ("e", ["stop"]),
        ("aE m", ["stop"]),
        ("a", [True]),
        ("d", [False]),
        ("am", [True, Mode.AUTO]),
        ("h", [Mode.HOLD]),
        ("R", [Mode.RTL]),
        ("?", ["help"]),
    ],
)
def test_each_key_asks_for_one_thing_and_an_emergency_for_nothing_else(
    pressed: str, asked: list[object]
) -> None:
    robot = Robot()
    obey(pressed, robot, robot)
    assert robot.asked == asked


def test_every_key_is_explained() -> None:
    for key in "admhr?":
        assert f" {key} " in BRIEF
        assert any(f" {key} " in f" {line} " for line in HELP)
    assert all(len(line) <= 80 for line in (BRIEF, *HELP))
