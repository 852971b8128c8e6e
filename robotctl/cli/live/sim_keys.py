"""The keys of a simulated run: what an operator would have a ground station for."""

from __future__ import annotations

import re
from typing import Final, Protocol

from robotctl.cli.live.keys import EMERGENCY_KEYS, HINT
from robotctl.messages.control import ControlState, SafetyState
from robotctl.messages.mode import Mode

BRIEF: Final = f"{HINT}  a arm  d disarm  m mission  h hold  r home  ? help"

HELP: Final = (
    f"{HINT}; the robot stands until it is armed again",
    "a  arm, also after a stop        d  disarm: the motors are off",
    "m  AUTO: drive the mission, from its present item",
    "h  HOLD: stand still             r  RTL: return home",
    "?  this help                     Ctrl-C  end the run and show its score",
    "Sticks, velocities and positions come from a ground station, see `connect`.",
)

AGAIN: Final = "a arms it again, m then resumes the mission, Ctrl-C ends"
"""Advice after a stop."""

_SEQUENCE: Final = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]?|O.?|.?)", re.DOTALL)
"""A terminal's codes for other keys (ECMA-48): arrow up is `ESC [ A`."""

_MODES: Final = {"m": Mode.AUTO, "h": Mode.HOLD, "r": Mode.RTL}


class Robot(Protocol):
    """Actions of the keys."""

    def emergency_key(self) -> None:
        """Stop at once."""

    def arm(self, *, arm: bool) -> None:
        """Ask to arm or disarm."""

    def set_mode(self, mode: Mode) -> None:
        """Ask for a mode."""


class Helpful(Protocol):
    """A view that can show the keys."""

    def help(self) -> None:
        """Show them, or show them no more."""


def obey(pressed: str, robot: Robot, view: Helpful) -> None:
    """Do what the keys say; an emergency stop among them is all that counts."""
    if not EMERGENCY_KEYS.isdisjoint(pressed):
        robot.emergency_key()
        return
    for key in _SEQUENCE.sub("", pressed).lower():
        if key in "ad":
            robot.arm(arm=key == "a")
        elif key in _MODES:
            robot.set_mode(_MODES[key])
        elif key == "?":
            view.help()


def what_now(control: ControlState, *, keys: bool) -> str:
    """Return advice on a robot at rest; empty if it may drive."""
    if control.state in (SafetyState.FAULT, SafetyState.EMERGENCY_STOP):
        return AGAIN if keys else "a ground station can arm it again"
    if control.state is SafetyState.STANDBY:
        return "a arms it" if keys else "a ground station can arm it"
    return ""
