"""Mode changes: MAV_CMD_DO_SET_MODE and the older SET_MODE message."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import common

from robotctl.planning.requests import REQUEST_LIFE_NS
from robotctl.runtime.mavlink_port import Message, Peer
from robotctl.runtime.messages import Mode, SetMode
from robotctl.telemetry.commands import (
    ACCEPTED,
    DENIED,
    TEMPORARILY_REJECTED,
    Command,
    acknowledge,
)
from robotctl.telemetry.service import Context

DO_SET_MODE: int = common.MAV_CMD_DO_SET_MODE
CUSTOM: int = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
TIMEOUT_NS = REQUEST_LIFE_NS + 100_000_000
"""How long the navigation process may take [ns].

It drops the request by itself after `REQUEST_LIFE_NS`; one that it took just before then is in its
next state, which is here in time.
"""

WARNING = 4


@dataclass(frozen=True, slots=True)
class _Pending:
    command: Command | None
    mode: Mode
    asked_ns: int


class Modes:
    """Asks for modes; the command is accepted when the navigation process is in the mode."""

    handles = frozenset({common.MAVLINK_MSG_ID_SET_MODE})
    commands = frozenset({DO_SET_MODE})

    def __init__(self, context: Context) -> None:
        self._context = context
        self._pending: _Pending | None = None

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take SET_MODE, which has no acknowledgement."""
        mode = self._wanted(message.base_mode, message.custom_mode, now_ns)
        if mode is not None:
            self._ask(None, mode, now_ns)

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Take DO_SET_MODE: param1 flags with CUSTOM_MODE_ENABLED, param2 ArduRover's number."""
        mode = self._wanted(command.params[0], command.params[1], now_ns)
        if mode is None:
            return DENIED
        if self._pending is not None and self._is_repeated(self._pending, command, mode):
            return None
        self._ask(command, mode, now_ns)
        return None

    def _wanted(self, base_mode: float, custom_mode: float, now_ns: int) -> Mode | None:
        if not (0.0 <= base_mode <= 255.0 and int(base_mode) & CUSTOM):
            self._context.say(now_ns, WARNING, "Mode: needs the flag CUSTOM_MODE_ENABLED")
            return None
        for mode in Mode:
            if custom_mode == float(mode):
                return mode
        allowed = ", ".join(f"{mode.name} {mode.value}" for mode in Mode)
        self._context.say(now_ns, WARNING, f"Mode {custom_mode:g}: allowed {allowed}")
        return None

    @staticmethod
    def _is_repeated(pending: _Pending, command: Command, mode: Mode) -> bool:
        before = pending.command
        return before is not None and before.sender == command.sender and pending.mode == mode

    def _ask(self, command: Command | None, mode: Mode, now_ns: int) -> None:
        if self._pending is not None:
            self._answer(self._pending, TEMPORARILY_REJECTED)
        self._context.requests.append(SetMode(now_ns, mode))
        self._pending = _Pending(command, mode, now_ns)

    def step(self, now_ns: int) -> None:
        """Acknowledge the mode that was taken, or was not in time."""
        pending = self._pending
        if pending is None:
            return
        navigation = self._context.fresh_navigation(now_ns)
        if (
            navigation is not None
            and navigation.stamp_ns > pending.asked_ns
            and navigation.mode == pending.mode
        ):
            self._answer(pending, ACCEPTED)
        elif now_ns - pending.asked_ns > TIMEOUT_NS:
            why = "navigation does not answer" if navigation is None else navigation.message
            self._context.say(now_ns, WARNING, f"Mode {pending.mode.name} not taken: {why}")
            self._answer(pending, TEMPORARILY_REJECTED)

    def _answer(self, pending: _Pending, result: int) -> None:
        self._pending = None
        if pending.command is not None:
            acknowledge(self._context, pending.command, result)
