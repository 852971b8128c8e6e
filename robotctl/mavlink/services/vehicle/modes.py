"""Mode changes: MAV_CMD_DO_SET_MODE and the older SET_MODE message.

A late copy of a request for a mode in which the robot may move is not carried out, `command_dedup`
says which: it would repeat a completed mission, or drive off again after HOLD. HOLD is carried out
however often it comes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    MAX_PENDING,
    TEMPORARILY_REJECTED,
    Command,
    Frame,
)
from robotctl.mavlink.context import Context
from robotctl.mavlink.guards.command_dedup import LateCopies
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.vehicle.mode_list import STANDARD
from robotctl.messages.control import Mode, SafetyState, SetMode
from robotctl.messages.mavlink_port import Address, Message, Peer, source
from robotctl.messages.requests import REQUEST_LIFE_NS
from robotctl.safety.state_machine import POWERED

DO_SET_MODE: int = common.MAV_CMD_DO_SET_MODE
MISSION_START: int = common.MAV_CMD_MISSION_START
RETURN: int = common.MAV_CMD_NAV_RETURN_TO_LAUNCH
SET_STANDARD_MODE: int = common.MAV_CMD_DO_SET_STANDARD_MODE
PAUSE_CONTINUE: int = common.MAV_CMD_DO_PAUSE_CONTINUE
BY_STANDARD: Final = {float(number): mode for mode, number in STANDARD.items()}
CUSTOM: int = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
TIMEOUT_NS = REQUEST_LIFE_NS + 100_000_000
"""Maximum time of the navigation process's answer [ns].

It drops the request by itself after `REQUEST_LIFE_NS`; one that it took just before then is in its
next state, which is here in time.
"""


@dataclass(frozen=True, slots=True)
class _Pending:
    """A sender's request; `commands` to answer, the last of each connection, none of SET_MODE."""

    mode: Mode
    asked_ns: int
    commands: dict[Peer, Command] = field(default_factory=dict)
    sequences: set[int] = field(default_factory=set)
    """Numbers of the frames that asked for it."""

    def wait(self, command: Command) -> None:
        """Answer a command, too."""
        self.commands[command.peer] = command
        self.sequences.add(command.sequence)


class Modes(Microservice):
    """Asks for modes; the command is accepted when the navigation process is in the mode."""

    handles = frozenset({common.MAVLINK_MSG_ID_SET_MODE})
    commands = frozenset({DO_SET_MODE, SET_STANDARD_MODE, MISSION_START, RETURN, PAUSE_CONTINUE})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._pending: dict[Address, _Pending] = {}
        """Pending requests by sender, all for the same mode: one for another mode ends them."""
        self._copies = LateCopies()

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take SET_MODE, which has no acknowledgement."""
        mode = self._wanted(message.base_mode, message.custom_mode, now_ns)
        sender = source(message)
        if mode is None or self._is_repeated(sender, mode, now_ns):
            return
        if self._is_held_back(peer, sender, mode, now_ns):
            return
        frame = Frame(sender, message.get_seq())
        if self._of_copy(frame, mode, now_ns) is None and self._ask(sender, mode, now_ns):
            self._pending[sender].sequences.add(frame.sequence)

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Take DO_SET_MODE: param1 flags with CUSTOM_MODE_ENABLED, param2 the personality's number.

        MISSION_START asks for AUTO, which begins with arming where the robot is not armed,
        NAV_RETURN_TO_LAUNCH for RTL, DO_PAUSE_CONTINUE for HOLD (param1 0) and AUTO (1),
        DO_SET_STANDARD_MODE for AUTO and RTL by their MAV_STANDARD_MODE.
        """
        mode = self._mode_of(command, now_ns)
        if mode is None:
            return DENIED
        if self._is_repeated(command.sender, mode, now_ns):
            self._pending[command.sender].wait(command)
            return None
        if self._is_held_back(command.peer, command.sender, mode, now_ns):
            return TEMPORARILY_REJECTED
        copy = self._of_copy(command.origin, mode, now_ns)
        if copy is not None:
            return copy
        if not self._ask(command.sender, mode, now_ns):
            return TEMPORARILY_REJECTED
        self._pending[command.sender].wait(command)
        return None

    def on_cancel(self, command: Command, now_ns: int) -> None:
        """Take back a request for a mode: HOLD, in case navigation is about to take it."""
        pending = self._pending.pop(command.sender, None)
        if pending is not None:
            for waiting in pending.commands.values():
                self._context.acknowledge(waiting, CANCELLED)
            self._context.requests.append(SetMode(now_ns, Mode.HOLD))

    def _is_held_back(self, peer: Peer, sender: Address, mode: Mode, now_ns: int) -> bool:
        """Return whether a request for a mode in which the robot may move may be an old one."""
        objection = self._context.held_back.objection(peer, sender, now_ns)
        if mode is Mode.HOLD or not objection:
            return False
        self._context.say(now_ns, f"Mode {mode.name}: {objection}")
        return True

    def _of_copy(self, frame: Frame, mode: Mode, now_ns: int) -> int | None:
        """Return the answer to a late copy, None if the request is to be carried out."""
        copy = self._copies.answer(frame, mode, now_ns, holds=self._holds(mode, now_ns))
        if copy == TEMPORARILY_REJECTED:
            text = f"Mode {mode.name}: asked for a moment ago, ask again"
            self._context.say(now_ns, text)
        return copy

    def _holds(self, mode: Mode, now_ns: int) -> bool:
        """Return whether the robot is in `mode`; AUTO is over at the mission's end."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None or navigation.mode != mode:
            return False
        ended = navigation.mission_completed or navigation.mission_failed
        return not (mode is Mode.AUTO and ended)

    def _mode_of(self, command: Command, now_ns: int) -> Mode | None:
        """Return the mode that a command asks for, None where there is no such mode."""
        if command.number == MISSION_START:
            return Mode.AUTO
        if command.number == RETURN:
            return Mode.RTL
        if command.number == SET_STANDARD_MODE:
            return BY_STANDARD.get(command.params[0])
        if command.number == PAUSE_CONTINUE:
            return {0.0: Mode.HOLD, 1.0: Mode.AUTO}.get(command.params[0])
        base_mode, second, third, *_ = command.params
        return self._wanted(base_mode, self._context.personality.custom_mode(second, third), now_ns)

    def _wanted(self, base_mode: float, custom_mode: float, now_ns: int) -> Mode | None:
        if not (0.0 <= base_mode <= 255.0 and int(base_mode) & CUSTOM):
            self._context.say(now_ns, "Mode: needs the flag CUSTOM_MODE_ENABLED")
            return None
        personality = self._context.personality
        mode = personality.mode_of(custom_mode)
        if mode is not None:
            return mode
        allowed = ", ".join(f"{mode.name} {number}" for mode, number in personality.modes.items())
        self._context.say(now_ns, f"Mode {custom_mode:g}: allowed {allowed}")
        return None

    def _is_repeated(self, sender: Address, mode: Mode, now_ns: int) -> bool:
        """Say whether a sender waits for that mode already; HOLD is carried out all the same."""
        pending = self._pending.get(sender)
        if pending is None or pending.mode is not mode:
            return False
        if mode is Mode.HOLD:
            self._context.requests.append(SetMode(now_ns, mode))
        return True

    def _ask(self, sender: Address, mode: Mode, now_ns: int) -> bool:
        """Request a mode; return whether there is room to wait for the result.

        Where there is none, the mode has been asked for; HOLD is carried out all the same.
        """
        for other, pending in list(self._pending.items()):
            if pending.mode is not mode:
                self._answer(other, TEMPORARILY_REJECTED, now_ns)
        has_room = len(self._pending) < MAX_PENDING
        if has_room or mode is Mode.HOLD:
            self._context.requests.append(SetMode(now_ns, mode))
        if has_room:
            self._pending[sender] = _Pending(mode, now_ns)
        return has_room

    def step(self, now_ns: int) -> None:
        """Acknowledge the mode that was taken, or was not in time."""
        navigation = self._context.fresh_navigation(now_ns)
        refusal = ""
        for sender, pending in list(self._pending.items()):
            if (
                navigation is not None
                and navigation.stamp_ns > pending.asked_ns
                and navigation.mode == pending.mode
            ):
                self._answer(sender, ACCEPTED, now_ns)
            elif now_ns - pending.asked_ns > TIMEOUT_NS:
                why = "navigation does not answer" if navigation is None else navigation.message
                refusal = f"Mode {pending.mode.name} not taken: {why}"
                self._answer(sender, TEMPORARILY_REJECTED, now_ns)
        if refusal:
            self._context.say(now_ns, refusal)

    def _missing(self, now_ns: int) -> str:
        """Return why the robot stands whatever its mode, empty if it does not or is just disarmed.

        The mode is had all the same: it counts once the robot is armed.
        """
        control = self._context.fresh_control(now_ns)
        if control is None:
            return "control is silent"
        if control.state in POWERED or control.state is SafetyState.STANDBY:
            return ""
        why = f": {control.reason}" if control.reason else ""
        return f"arm to drive, the state is {control.state.name}{why}"

    def _answer(self, sender: Address, result: int, now_ns: int) -> None:
        pending = self._pending.pop(sender)
        if pending.mode is not Mode.HOLD:
            self._copies.remember(sender, pending.mode, result, now_ns, pending.sequences)
            if result == ACCEPTED and (missing := self._missing(now_ns)):
                self._context.say(now_ns, f"Mode {pending.mode.name}: {missing}")
        for command in pending.commands.values():
            self._context.acknowledge(command, result)
