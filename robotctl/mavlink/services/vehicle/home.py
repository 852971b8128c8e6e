"""DO_SET_HOME: where RTL leads to."""

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
from robotctl.mavlink.missions.item import asked_place
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, SetHome
from robotctl.messages.requests import FARTHEST_M
from robotctl.model.geometry.se2 import SE2

_HERE = 1.0
"""Param1 of DO_SET_HOME that means the present place."""


class Homes(Microservice):
    """Moves home to where the robot is, or to a place it can plan a way to; tells all."""

    commands = frozenset({common.MAV_CMD_DO_SET_HOME})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._told = context.home

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take param1, 1: here; 0: at x and y of a COMMAND_INT, param4 its yaw [deg]."""
        pose = self._context.known_pose(now_ns)
        home = pose if command.params[0] == _HERE else self._place(command, pose)
        result, why = self._objection(command, home, now_ns)
        if why:
            self._context.say(now_ns, f"Home: {why}")
        elif home is not None:
            self._context.requests.append(SetHome(now_ns, home.x_m, home.y_m, home.theta_rad))
        return result

    def step(self, now_ns: int) -> None:
        """Send HOME_POSITION when home has moved."""
        if self._context.home != self._told:
            self._told = self._context.home
            stream = self._context.catalogue.streams[common.MAVLINK_MSG_ID_HOME_POSITION]
            for each in stream.build(now_ns):
                self._context.links.broadcast(each)

    def _objection(self, command: Command, home: SE2 | None, now_ns: int) -> tuple[int, str]:
        """Return the MAV_RESULT, and why home stays where it is; empty: it moves."""
        context, is_here = self._context, command.params[0] == _HERE
        if not is_here and command.params[0] != 0.0:
            return DENIED, f"param1 is {command.params[0]:g}, 0 or 1 allowed"
        if not is_here and command.frame is None:  # degrees in a float are off by a metre
            return INT_ONLY, "a place needs a COMMAND_INT"
        if home is None and not is_here:
            return UNSUPPORTED_FRAME, f"frame {command.frame} means nothing here"
        if context.fresh_navigation(now_ns) is None or home is None:
            return TEMPORARILY_REJECTED, "the robot does not know where it is"
        if context.mode(now_ns) is Mode.RTL:
            return TEMPORARILY_REJECTED, "not while the robot drives there"
        if not max(abs(home.x_m), abs(home.y_m)) < FARTHEST_M:
            return DENIED, f"{FARTHEST_M / 1e3:g} km away or farther"
        if not is_here and not context.robot.plans:
            return DENIED, "only here: it returns the way it came"
        return ACCEPTED, ""

    def _place(self, command: Command, pose: SE2 | None) -> SE2 | None:
        """Return the pose in `world` that is asked for; None where its frame means nothing."""
        place = asked_place(command, self._context.origin)
        if place is None:
            return None
        yaw_rad = math.radians(command.params[3])
        if math.isfinite(yaw_rad):
            return SE2(*place, theta_from_yaw_ned(yaw_rad))
        return SE2(*place, 0.0 if pose is None else pose.theta_rad)
