"""Arming, disarming and the emergency stop.

| command | meaning |
|---|---|
| COMPONENT_ARM_DISARM, param1 1 | arm; param2 21196 ("force") does not get round any check |
| COMPONENT_ARM_DISARM, param1 0 | disarm |
| COMPONENT_ARM_DISARM, param1 0, param2 21196 | emergency stop |
| RUN_PREARM_CHECKS | say what speaks against arming |
| DO_FLIGHTTERMINATION, param1 1 | emergency stop |
| DO_FLIGHTTERMINATION, param1 0 | denied: only arming ends an emergency stop |

Arming and disarming are acknowledged when the control process has answered. A request to arm that
is repeated meanwhile, or a little later as `command_dedup` says, is not carried out again: a late
copy on another link must not arm a robot that was stopped in between. Where it was, the answer is
"temporarily rejected". Disarming and stops are always carried out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    MAX_PENDING,
    TEMPORARILY_REJECTED,
    Command,
)
from robotctl.mavlink.context import LOCALISER_NOT_READY, Context
from robotctl.mavlink.guards.command_dedup import LateCopies
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Ack, Arm, EmergencyStop, EmergencyStopSource
from robotctl.messages.mavlink_port import Address, Peer
from robotctl.safety.state_machine import POWERED

ARM_DISARM: int = common.MAV_CMD_COMPONENT_ARM_DISARM
FLIGHT_TERMINATION: int = common.MAV_CMD_DO_FLIGHTTERMINATION
RUN_CHECKS: int = common.MAV_CMD_RUN_PREARM_CHECKS
FORCE = 21196.0
"""Param2 of COMPONENT_ARM_DISARM that forces (MAVLink: 21196)."""

ANSWER_NS = 1_000_000_000
"""Maximum time of the answer after the control process has given up [ns]."""


@dataclass(frozen=True, slots=True)
class _Pending:
    """A request of one sender; `commands` to answer, the last of each connection."""

    sender: Address
    commands: dict[Peer, Command]
    arm: bool
    deadline_ns: int
    sequences: set[int]
    """Numbers of the frames that asked for it."""

    def wait(self, command: Command) -> None:
        """Answer a command, too."""
        self.commands[command.peer] = command
        self.sequences.add(command.sequence)


class Arming(Microservice):
    """Turns the commands of the table above into requests and the answers into COMMAND_ACK."""

    commands = frozenset({ARM_DISARM, FLIGHT_TERMINATION, RUN_CHECKS})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._timeout_ns = round(context.robot.arm_timeout_s * 1e9) + ANSWER_NS
        self._pending: dict[int, _Pending] = {}
        self._copies = LateCopies()
        self._last_request = 0

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Carry out one command of the table."""
        if command.number == FLIGHT_TERMINATION:
            return self._terminate(command, now_ns)
        if command.number == RUN_CHECKS:
            return self._check(now_ns)
        if command.params[0] == 1.0:
            return self._arm(command, now_ns)
        if command.params[0] == 0.0:
            return self._disarm(command, now_ns)
        self._context.say(now_ns, f"Arm: neither 0 nor 1: {command.params[0]:g}")
        return DENIED

    def _terminate(self, command: Command, now_ns: int) -> int:
        if command.params[0] == 1.0:
            self._copies.ask(command.sender, FLIGHT_TERMINATION)
            return self._stop(now_ns)
        self._context.say(now_ns, "Emergency stop: only arming ends it")
        return DENIED

    def _check(self, now_ns: int) -> int:
        """Say what speaks against arming; refused while the robot is armed, as ArduPilot does."""
        reasons = self._context.against_arming(now_ns)
        if reasons is None:
            return TEMPORARILY_REJECTED
        for reason in reasons:
            self._context.say(now_ns, f"PreArm: {reason}")
        return ACCEPTED

    def _stop(self, now_ns: int) -> int:
        source = EmergencyStopSource.GROUND_STATION
        self._context.requests.append(EmergencyStop(now_ns, source))
        return ACCEPTED

    def _arm(self, command: Command, now_ns: int) -> int | None:
        if objection := self._context.held_back.objection(command.peer, command.sender, now_ns):
            self._context.say(now_ns, f"Arm: {objection}")
            return TEMPORARILY_REJECTED
        if (repeated := self._find(command.sender, arm=True)) is not None:
            self._pending[repeated].wait(command)
            return None
        control = self._context.fresh_control(now_ns)
        armed = control is not None and control.state in POWERED
        copy = self._copies.answer(command.origin, _meaning(command), now_ns, holds=armed)
        if copy is not None:
            if copy == TEMPORARILY_REJECTED:
                self._context.say(now_ns, "Arm: asked for a moment ago, ask again")
            return copy
        if not self._context.has_localiser_ready(now_ns):
            self._context.say(now_ns, f"Arm: {LOCALISER_NOT_READY}")
            return TEMPORARILY_REJECTED
        return self._ask(command, {}, now_ns, arm=True)

    def _disarm(self, command: Command, now_ns: int) -> int | None:
        self._copies.ask(command.sender, _meaning(command))
        if command.params[1] == FORCE:
            return self._stop(now_ns)
        before: dict[Peer, Command] = {}
        if (repeated := self._find(command.sender, arm=False)) is not None:
            before = self._pending.pop(repeated).commands  # answered with the new request
        return self._ask(command, before, now_ns, arm=False)

    def on_cancel(self, command: Command, now_ns: int) -> None:
        """Take back a request to arm: disarm, in case control is about to do it."""
        if command.number != ARM_DISARM:
            return
        number = self._find(command.sender, arm=True)
        if number is None:
            return
        for waiting in self._pending.pop(number).commands.values():
            self._context.acknowledge(waiting, CANCELLED)
        self._last_request = max(self._last_request + 1, now_ns)
        self._context.requests.append(Arm(now_ns, self._last_request, arm=False))

    def _find(self, sender: Address, *, arm: bool) -> int | None:
        """Return the number of this sender's request that waits for its answer."""
        for request_id, pending in self._pending.items():
            if pending.arm == arm and pending.sender == sender:
                return request_id
        return None

    def _ask(
        self, command: Command, before: dict[Peer, Command], now_ns: int, *, arm: bool
    ) -> int | None:
        is_full = len(self._pending) >= MAX_PENDING
        if arm and is_full:
            return TEMPORARILY_REJECTED
        # Numbers from the clock differ from those before a restart of this process, to which the
        # control process's present answer may still belong.
        self._last_request = max(self._last_request + 1, now_ns)
        self._context.requests.append(Arm(now_ns, self._last_request, arm))
        if is_full:
            return TEMPORARILY_REJECTED
        deadline_ns = now_ns + self._timeout_ns
        pending = _Pending(command.sender, before, arm, deadline_ns, set())
        pending.wait(command)
        self._pending[self._last_request] = pending
        return None

    def step(self, now_ns: int) -> None:
        """Acknowledge what the control process has answered, or has not answered in time."""
        for ack in self._context.acks:
            if (pending := self._pending.pop(ack.request_id, None)) is not None:
                self._finish(pending, ack, now_ns)
        for request_id, pending in list(self._pending.items()):
            if now_ns > pending.deadline_ns:
                del self._pending[request_id]
                self._context.say(now_ns, f"{_verb(pending)}: control does not answer")
                self._answer(pending, TEMPORARILY_REJECTED, now_ns)

    def _finish(self, pending: _Pending, ack: Ack, now_ns: int) -> None:
        if not ack.accepted:
            for reason in ack.reasons or ("refused",):
                self._context.say(now_ns, f"{_verb(pending)}: {reason}")
        self._answer(pending, ACCEPTED if ack.accepted else DENIED, now_ns)

    def _answer(self, pending: _Pending, result: int, now_ns: int) -> None:
        for command in pending.commands.values():
            self._context.acknowledge(command, result)
            if pending.arm:
                self._copies.remember(
                    pending.sender, _meaning(command), result, now_ns, pending.sequences
                )


def _meaning(command: Command) -> tuple[float, bool]:
    """Return what distinguishes requests: param1, and whether param2 is "force".

    Senders may fill what they do not use with NaN, which differs from itself.
    """
    return command.params[0], command.params[1] == FORCE


def _verb(pending: _Pending) -> str:
    return "Arm" if pending.arm else "Disarm"
