"""The operator of a simulated run: arms the robot and lets it begin its mission, each once."""

from __future__ import annotations

import itertools
from typing import Final

from robotctl.messages.control import Arm, ControlState, Mode, NavigationState, SafetyState, SetMode
from robotctl.safety.state_machine import POWERED

_AGAIN_NS: Final = 500_000_000
"""Interval between two requests for the same thing [ns]."""


class MissionOperator:
    """Asks for arming, then for mode AUTO, each until it has been had once.

    From then on it is for others to arm, and to choose who steers: a robot that was held, taken
    over or disarmed stays so.
    """

    def __init__(self) -> None:
        self._ids = itertools.count(1)
        self._control: ControlState | None = None
        self._navigation: NavigationState | None = None
        self._was_armed = self._was_steered = False
        self._arming_ns = self._mode_ns = -_AGAIN_NS

    def hear(self, message: ControlState | NavigationState) -> None:
        """Take note of how the robot is."""
        if isinstance(message, ControlState):
            self._control = message
            self._was_armed |= message.state in POWERED
        else:
            self._navigation = message
            self._was_steered |= message.mode != Mode.HOLD

    def arm(self, now_ns: int, *, arm: bool) -> Arm:
        """Return the request to arm or disarm from the keyboard, which takes over the robot."""
        self._was_armed = True
        return Arm(now_ns, next(self._ids), arm=arm)

    def set_mode(self, now_ns: int, mode: Mode) -> SetMode:
        """Return the request for a mode from the keyboard, which takes over the robot."""
        self._was_steered = True
        return SetMode(now_ns, mode)

    def arming(self, now_ns: int) -> Arm | None:
        """Return the request to arm, if it is time for one and navigation is there."""
        control = self._control
        if control is None or self._navigation is None or self._was_armed:
            return None
        if control.state != SafetyState.STANDBY or now_ns - self._arming_ns < _AGAIN_NS:
            return None
        self._arming_ns = now_ns
        return Arm(now_ns, next(self._ids), arm=True)

    def mode(self, now_ns: int) -> SetMode | None:
        """Return the request for AUTO, if it is time for one."""
        control = self._control
        if control is None or self._navigation is None or self._was_steered:
            return None
        if control.state not in POWERED or now_ns - self._mode_ns < _AGAIN_NS:
            return None
        self._mode_ns = now_ns
        return SetMode(now_ns, Mode.AUTO)
