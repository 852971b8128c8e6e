"""Commands that stations offer and the robot refuses, each with what to do in its place."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import DENIED, Command
from robotctl.mavlink.service import Microservice

_REASONS: Final[dict[int, str]] = {
    common.MAV_CMD_DO_SET_HOME: "Home: it is where the robot started",
}


class Refusals(Microservice):
    """Denies, and says why."""

    commands = frozenset(_REASONS)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Deny one command."""
        self._context.say(now_ns, _REASONS[command.number])
        return DENIED
