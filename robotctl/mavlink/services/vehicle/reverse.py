"""DO_SET_REVERSE: the robot drives to places in reverse, or ahead again."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import ACCEPTED, CANCELLED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.vehicle.modes import TIMEOUT_NS
from robotctl.messages.control import Mode, SetReverse


@dataclass(frozen=True, slots=True)
class _Pending:
    """A command that navigation has not answered."""

    command: Command
    reverse: bool
    asked_ns: int


class Reverses(Microservice):
    """Takes param1, 0 ahead or 1 in reverse; accepted when navigation has taken it."""

    commands = frozenset({common.MAV_CMD_DO_SET_REVERSE})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._pending: _Pending | None = None

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Ask navigation, in AUTO and GUIDED alone."""
        context, pending = self._context, self._pending
        if command.params[0] not in {0.0, 1.0}:
            context.say(now_ns, f"Reverse: {command.params[0]:g} found, 0 or 1 allowed")
            return DENIED
        reverse = command.params[0] == 1.0
        if pending is not None:
            if pending.command.key == command.key and pending.reverse is reverse:
                return None
            return TEMPORARILY_REJECTED
        if reverse and context.mode(now_ns) not in {Mode.AUTO, Mode.GUIDED}:
            context.say(now_ns, "Reverse: in AUTO and GUIDED only, until the mode changes")
            return TEMPORARILY_REJECTED
        self._pending = _Pending(command, reverse, now_ns)
        context.requests.append(SetReverse(now_ns, reverse))
        return None

    def on_cancel(self, command: Command, now_ns: int) -> None:
        """Take it back: what was asked for last may be about to be taken."""
        pending = self._pending
        if pending is not None and pending.command.key == command.key:
            navigation = self._context.fresh_navigation(now_ns)
            was = navigation is not None and navigation.reverse
            self._context.requests.append(SetReverse(now_ns, was))
            self._end(CANCELLED)

    def step(self, now_ns: int) -> None:
        """Acknowledge what navigation has taken, or has not in time."""
        pending = self._pending
        if pending is None:
            return
        navigation = self._context.fresh_navigation(now_ns)
        answered = navigation is not None and navigation.stamp_ns > pending.asked_ns
        if navigation is not None and answered and navigation.reverse is pending.reverse:
            self._end(ACCEPTED)
        elif now_ns - pending.asked_ns > TIMEOUT_NS:
            why = "navigation does not answer" if navigation is None else navigation.message
            self._context.say(now_ns, f"Reverse: not taken: {why}")
            self._end(TEMPORARILY_REJECTED)

    def _end(self, result: int) -> None:
        """Acknowledge the command that waits."""
        if self._pending is not None:
            pending, self._pending = self._pending, None
            self._context.acknowledge(pending.command, result)
