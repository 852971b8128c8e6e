"""PREFLIGHT_CALIBRATION and DO_MOTOR_TEST: what control carries out on a disarmed robot.

Both are acknowledged with IN_PROGRESS while they last, and with their result; COMMAND_CANCEL ends
them at once. One is under way at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.mavlink.at_rest import objection
from robotctl.mavlink.command import (
    ACCEPTED,
    CANCELLED,
    FAILED,
    TEMPORARILY_REJECTED,
    Command,
)
from robotctl.mavlink.context import Context
from robotctl.mavlink.guards.command_dedup import LateCopies
from robotctl.mavlink.procedure_commands import (
    CALIBRATION,
    MOTOR_TEST,
    Refusal,
    Turn,
    asks_for_nothing,
    motor_test,
    not_a_gyro,
)
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.procedures import CalibrateGyro, CancelProcedure, MotorTest, Outcome

ANSWER_NS: Final = 1_000_000_000
"""Control begins or refuses within this time [ns]."""

SILENT_NS: Final = 1_500_000_000
"""Silence after which a station that asked for a motor test counts as gone [ns]: heartbeats come
each second."""

LIFE_NS: Final = 200_000_000
"""Time for which a wheel turns on without this process [ns]."""

_RENEWED_NS: Final = 50_000_000
_STEP_PERCENT: Final = 10
"""Progress after which the sender is told again [%]."""
_RESULTS: Final = {
    Outcome.DONE: ACCEPTED,
    Outcome.REFUSED: TEMPORARILY_REJECTED,
    Outcome.FAILED: FAILED,
    Outcome.CANCELLED: CANCELLED,
}


_PX4_ENDS: Final = {
    ACCEPTED: "calibration done: gyro",
    FAILED: "calibration failed: {}",
    CANCELLED: "calibration cancelled",
}


@dataclass(slots=True)
class _UnderWay:
    """A procedure that was asked for; `turn` is that of a motor test."""

    command: Command
    number: int
    asked_ns: int
    turn: Turn | None
    renewed_ns: int = 0
    told_percent: int = -_STEP_PERCENT
    silent: bool = False


class Procedures(Microservice):
    """Asks control for them, and tells who has asked how they get on."""

    commands = frozenset({CALIBRATION, MOTOR_TEST})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._under_way: _UnderWay | None = None
        self._copies = LateCopies()
        self._last_number = 0

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Begin one of them; all of its numbers 0, or no throttle, end it."""
        under_way = self._under_way
        if under_way is not None and _is_repeated(command, under_way.command):
            self._context.tell_progress(command, max(under_way.told_percent, 0), now_ns)
            return None
        turn: Turn | None = None
        if command.number == CALIBRATION:
            refusal = not_a_gyro(command, has_imu=self._context.robot.has_imu)
        else:
            control = self._context.fresh_control(now_ns)
            found = motor_test(command, 2 if control is None else len(control.duty))
            refusal = found if isinstance(found, Refusal) else None
            turn = None if isinstance(found, Refusal) else found
        if refusal is not None:
            return self._refuse(command, refusal.result, refusal.why, now_ns)
        if asks_for_nothing(command, turn):
            if under_way is not None and under_way.command.number == command.number:
                self._cancel(under_way, now_ns)
            self._copies.ask(command.sender, None)
            return ACCEPTED
        return self._begin(command, turn, now_ns)

    def _begin(self, command: Command, turn: Turn | None, now_ns: int) -> int | None:
        """Ask control, unless something speaks against it."""
        context = self._context
        why = objection(context, now_ns)
        if self._under_way is not None:
            why = "a calibration or a motor test is under way"
        elif turn is not None:
            why = context.held_back.objection(command.peer, command.sender, now_ns) or why
            copy = self._copies.answer(command.origin, _meaning(command), now_ns, holds=False)
            why = why if copy is None else "asked for a moment ago, ask again"
        if why:
            return self._refuse(command, TEMPORARILY_REJECTED, why, now_ns)
        self._last_number = max(self._last_number + 1, now_ns)
        self._under_way = _UnderWay(command, self._last_number, now_ns, turn)
        if turn is None:
            context.requests.append(CalibrateGyro(now_ns, self._last_number))
        return None

    def _refuse(self, command: Command, result: int, why: str, now_ns: int) -> int:
        self._context.say(now_ns, f"{_name(command)}: {why}")
        return result

    def on_cancel(self, command: Command, now_ns: int) -> None:
        """End it; it is acknowledged once it has ended."""
        under_way = self._under_way
        if under_way is not None and under_way.command.key == command.key:
            self._cancel(under_way, now_ns)

    def _cancel(self, under_way: _UnderWay, now_ns: int) -> None:
        """Have control end what is under way."""
        if under_way.turn is not None and under_way.renewed_ns == 0:
            self._finish(under_way, Outcome.CANCELLED, "cancelled", now_ns)  # it never began
            return
        under_way.turn = None  # it is not asked for any more
        self._context.requests.append(CancelProcedure(now_ns, under_way.number))

    def step(self, now_ns: int) -> None:
        """Ask for a motor test again as long as it is wanted; tell how it gets on."""
        under_way = self._under_way
        if under_way is None:
            return
        control = self._context.fresh_control(now_ns)
        procedure = None if control is None else control.procedure
        if procedure is not None and procedure.request_id == under_way.number:
            if procedure.outcome is not Outcome.RUNNING:
                self._finish(under_way, procedure.outcome, procedure.text, now_ns)
                return
            percent = round(100.0 * procedure.progress)
            if percent >= under_way.told_percent + _STEP_PERCENT:
                begins = under_way.told_percent < 0
                under_way.told_percent = percent
                words = "calibration started: 2 gyro" if begins else f"progress <{percent}>"
                self._tell_px4(under_way.command, words, now_ns)
                self._context.tell_progress(under_way.command, percent, now_ns)
        elif procedure is None or now_ns - under_way.asked_ns > ANSWER_NS:
            self._context.requests.append(CancelProcedure(now_ns, under_way.number))
            began = under_way.told_percent >= 0
            outcome = Outcome.FAILED if began else Outcome.REFUSED
            self._finish(under_way, outcome, "control does not answer", now_ns)
            return
        self._renew(under_way, now_ns)

    def _tell_px4(self, command: Command, words: str, now_ns: int) -> None:
        """Say how a calibration gets on in the words that PX4's stations wait for."""
        if command.number == CALIBRATION and self._context.personality.has_sub_modes:
            self._context.say(now_ns, f"[cal] {words}", Severity.INFORMATION)

    def _renew(self, under_way: _UnderWay, now_ns: int) -> None:
        """Ask for the motor test again, while who wants it is there."""
        turn, peer = under_way.turn, under_way.command.peer
        if turn is None:
            return
        heard_ns = self._context.heard_ns.get(peer, under_way.asked_ns)
        if peer not in self._context.peers or now_ns - heard_ns > SILENT_NS:
            under_way.silent = True
            self._cancel(under_way, now_ns)
        elif now_ns - under_way.renewed_ns >= _RENEWED_NS:
            under_way.renewed_ns = now_ns
            self._context.requests.append(
                MotorTest(
                    now_ns,
                    now_ns + LIFE_NS,
                    under_way.number,
                    turn.wheel,
                    turn.effort,
                    turn.duration_ns,
                )
            )

    def _finish(self, under_way: _UnderWay, outcome: Outcome, text: str, now_ns: int) -> None:
        """Acknowledge the result, and say what there is to say."""
        self._under_way = None
        command, result = under_way.command, _RESULTS[outcome]
        if under_way.silent and outcome is Outcome.CANCELLED:
            result, text = FAILED, "who asked for it is silent"
        severity = Severity.INFORMATION if result == ACCEPTED else Severity.WARNING
        if text:
            self._context.say(now_ns, f"{_name(command)}: {text}", severity)
        if result != TEMPORARILY_REJECTED:
            self._tell_px4(command, _PX4_ENDS[result].format(text), now_ns)
        if command.number == MOTOR_TEST:
            self._copies.remember(
                command.sender, _meaning(command), result, now_ns, [command.sequence]
            )
        self._context.acknowledge(command, result)


def _is_repeated(command: Command, before: Command) -> bool:
    """Say whether a command is the one of before, sent again."""
    return command.key == before.key and _meaning(command) == _meaning(before)


def _meaning(command: Command) -> str:
    """Return what is equal for commands that ask for the same; NaN differs from itself."""
    return str(command.params)


def _name(command: Command) -> str:
    return "Calibration" if command.number == CALIBRATION else "Motor test"
