"""DO_REPOSITION: go to a place, as "go to location" of ground stations asks for."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import (
    ACCEPTED,
    DENIED,
    INT_ONLY,
    TEMPORARILY_REJECTED,
    UNSUPPORTED_FRAME,
    Command,
)
from robotctl.mavlink.context import Context
from robotctl.mavlink.frames import theta_from_yaw_ned
from robotctl.mavlink.guards.command_dedup import LateCopies
from robotctl.mavlink.missions.item import asked_place
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, PositionTarget, SetMode
from robotctl.messages.requests import FARTHEST_M
from robotctl.safety.state_machine import POWERED

REPOSITION: int = common.MAV_CMD_DO_REPOSITION
CHANGE_MODE: int = common.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE


class Repositions(Microservice):
    """Drives an armed robot to a place in GUIDED; the flag CHANGE_MODE asks for that mode, too.

    A late copy is not carried out, `command_dedup` says which.
    """

    commands = frozenset({REPOSITION})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._copies = LateCopies()

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take a COMMAND_INT: param2 flags, param4 yaw [rad], x and y in its frame."""
        if command.frame is None:  # degrees in a float are off by a metre
            return INT_ONLY
        context = self._context
        drives = context.mode(now_ns) is Mode.GUIDED
        meaning = repr(command.params)  # nan is not equal to itself
        copy = self._copies.answer(command.origin, meaning, now_ns, holds=drives)
        if copy is not None:
            return copy
        place = asked_place(command, context.origin)
        result, why = self._objection(command, place, now_ns)
        if why:
            context.say(now_ns, f"Reposition: {why}")
        if place is not None and result == ACCEPTED:
            if not drives:
                context.requests.append(SetMode(now_ns, Mode.GUIDED))
            yaw_rad = command.params[3]
            heading_rad = theta_from_yaw_ned(yaw_rad) if math.isfinite(yaw_rad) else None
            context.requests.append(PositionTarget(now_ns, *place, heading_rad))
        self._copies.remember(command.sender, meaning, result, now_ns, [command.sequence])
        return result

    def _objection(
        self, command: Command, place: tuple[float, float] | None, now_ns: int
    ) -> tuple[int, str]:
        """Return the MAV_RESULT, and why the robot does not go there; empty: it goes."""
        context = self._context
        control, mode = context.fresh_control(now_ns), context.mode(now_ns)
        if place is None:
            return UNSUPPORTED_FRAME, f"frame {command.frame} means nothing here"
        if not max(map(abs, place)) < FARTHEST_M:
            return DENIED, f"{FARTHEST_M / 1e3:g} km away or farther"
        if why := context.fence_objection(*place, now_ns):
            return DENIED, why
        if control is None or control.state not in POWERED:
            return TEMPORARILY_REJECTED, "arm first"
        if mode is not Mode.GUIDED and not (command.whole(1) or 0) & CHANGE_MODE:
            return DENIED, f"mode {mode.name}, not GUIDED"
        if why := context.held_back.objection(command.peer, command.sender, now_ns):
            return TEMPORARILY_REJECTED, why
        return ACCEPTED, ""
