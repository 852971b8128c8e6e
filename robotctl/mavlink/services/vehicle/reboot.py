"""PREFLIGHT_REBOOT_SHUTDOWN: the robot's processes start again, or end.

The supervisor does it. The robot must be disarmed and at rest; param6, which asks to do it all the
same, does not get round that. Some stations ask for all there is at once, in param2 to param4 too:
they get what there is.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.at_rest import objection
from robotctl.mavlink.command import (
    ACCEPTED,
    DENIED,
    FAILED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
)
from robotctl.mavlink.context import Context
from robotctl.mavlink.guards.command_dedup import CONFIRMED_REPEAT_NS, LateCopies
from robotctl.mavlink.service import Microservice
from robotctl.messages.supervision import Restart, ShutDown

_NOTHING, _RESTART, _SHUT_DOWN = 0, 1, 2


class Reboots(Microservice):
    """Asks the supervisor: param1 1 starts the robot's processes again, 2 ends them."""

    commands = frozenset({common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._began_ns: int | None = None
        self._copies = LateCopies()

    def on_command(self, command: Command, now_ns: int) -> int:
        """Carry out one command; the answer goes out before this process ends."""
        result, why = self._carry_out(command, now_ns)
        if why:
            self._context.say(now_ns, f"Reboot: {why}")
        return result

    def _carry_out(self, command: Command, now_ns: int) -> tuple[int, str]:
        """Return the result, and the reason where it is a refusal."""
        action = command.whole(0)
        if action is None:
            return DENIED, f"{command.params[0]:g} found in param1, 0, 1 or 2 allowed"
        if action not in {_NOTHING, _RESTART, _SHUT_DOWN}:
            return UNSUPPORTED, f"{action} found in param1, 1 (restart) or 2 (shut down) allowed"
        if action == _NOTHING and any(command.whole(index) for index in (1, 2)):
            return UNSUPPORTED, "neither the computer nor a component (param2, 3), the robot alone"
        if action == _NOTHING or self._is_done(command, action, now_ns):
            return ACCEPTED, ""
        if action == _SHUT_DOWN and not self._context.config.allow_shutdown:
            return UNSUPPORTED, "shutting down needs mavlink.allow_shutdown in the robot's file"
        if why := objection(self._context, now_ns):
            return TEMPORARILY_REJECTED, why
        request = Restart(now_ns) if action == _RESTART else ShutDown(now_ns)
        if not self._context.ask_supervisor(request):
            return FAILED, "there is no supervisor to do it"
        self._copies.remember(command.sender, action, ACCEPTED, now_ns, [command.sequence])
        return ACCEPTED, ""

    def _is_done(self, command: Command, action: int, now_ns: int) -> bool:
        """Say whether a command repeats one that was carried out, by this process or the last.

        A sender repeats it where the answer was lost.
        """
        began_ns = now_ns if self._began_ns is None else self._began_ns
        is_of_before = command.confirmation > 0 and now_ns - began_ns < CONFIRMED_REPEAT_NS
        copy = self._copies.answer(command.origin, action, now_ns, holds=True)
        return is_of_before or copy is not None

    def step(self, now_ns: int) -> None:
        """Note when this process began."""
        if self._began_ns is None:
            self._began_ns = now_ns
