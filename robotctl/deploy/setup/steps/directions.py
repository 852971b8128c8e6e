"""Step: wheel and direction of each axis, one after the other at low speed on blocks."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, NamedTuple

from robotctl.deploy.setup.bench import Bench, Moved, Wheel
from robotctl.deploy.setup.dialogue import (
    Answer,
    Ask,
    Changes,
    Kind,
    Script,
    Tell,
    Topic,
    UnfinishedError,
)
from robotctl.deploy.setup.steps.asking import again_or_give_up, in_service, on_blocks
from robotctl.deploy.setup.wiring import axis_of, changes_of

NONE = "none"
_NO_TURN: Final = (
    "See that its motor is connected and has power, and that its drive turns so slowly at all "
    "(VESC: minimum ERPM of the speed loop)"
)
FORWARDS, BACKWARDS = "forwards", "backwards"


class _Seen(NamedTuple):
    """A motion as seen by the person."""

    wheel: str
    backwards: bool


def run(bench: Bench) -> Script:
    """Turn each wheel, ask which one turned and which way, and correct the axes."""
    yield from in_service(bench)
    yield from on_blocks()
    seen = {}
    for wheel in bench.wheels:
        seen[wheel.name] = yield from _see(bench, wheel)
    turned = [each.wheel for each in seen.values()]
    if len(set(turned)) < len(turned):
        raise UnfinishedError(
            f"{', '.join(turned)} turned where {', '.join(seen)} were commanded: each axis must "
            "turn a wheel of its own. See which axis turns which motor, and do this step again"
        )
    return _corrected(bench, seen)


def _see(bench: Bench, wheel: Wheel) -> Generator[Ask | Tell, Answer, _Seen]:
    """Turn the axis of a wheel until the person has seen which one turned, and which way."""
    number, place = axis_of(bench, wheel.name)
    motor = bench.config.motors[number]
    axis = f"{motor.name}, axis {motor.axes[place].axis}"
    names = tuple(each.name for each in bench.wheels)
    while True:
        yield Tell(f"{axis}: turns {wheel.name} slowly forwards, if all is right …")
        moved = bench.spin([wheel])
        if moved.stopped:
            yield Tell(f"Stopped: {moved.stopped}.")
        text = "Which wheel turned?"
        turned = yield Ask(Topic.WHEEL, text, Kind.CHOICE, (*names, NONE), wheel.name, wheel.name)
        if turned == NONE:
            problem = f"no wheel turned by {axis}"
            remedy = moved.stopped or _NO_TURN
            yield from again_or_give_up(problem, remedy)
            continue
        text = "Which way?"
        ways = (FORWARDS, BACKWARDS)
        way = yield Ask(Topic.WAY, text, Kind.CHOICE, ways, FORWARDS, str(turned))
        problem, remedy = _encoder_problem(bench, wheel, moved)
        if not problem:
            return _Seen(str(turned), way == BACKWARDS)
        yield from again_or_give_up(problem, remedy)


def _encoder_problem(bench: Bench, wheel: Wheel, moved: Moved) -> tuple[str, str]:
    """Return the problem in the report of a motion that was seen, and its remedy.

    The cause is the wiring, since the robot's file reverses motor and encoder together.
    """
    told_rad = moved.turned_rad[wheel.place]
    most = max(bench.wheels, key=lambda each: abs(moved.turned_rad[each.place]))
    if most is not wheel and abs(moved.turned_rad[most.place]) > 2.0 * abs(told_rad):
        return (
            f"the motor of {wheel.name} turned, but the encoder of {most.name} reports it",
            "Exchange the plugs of the two encoders, or those of the two motors",
        )
    if told_rad < -0.1:
        return (
            f"the encoder of {wheel.name} counts backwards when its motor drives forwards",
            "Exchange the motor's two wires, or channels A and B of the encoder, or calibrate it",
        )
    if abs(told_rad) < 0.1:
        return (
            f"the encoder of {wheel.name} does not report that it turned",
            "See that the encoder is connected and turns with the wheel",
        )
    return "", ""


def _corrected(bench: Bench, seen: dict[str, _Seen]) -> Changes:
    """Return the changes that assign each axis to the wheel that it was seen to turn."""
    axes = {}
    for name, each in seen.items():
        number, place = axis_of(bench, name)
        axis = bench.config.motors[number].axes[place]
        values = {}
        if each.wheel != name:
            values["actuator"] = each.wheel
        if each.backwards:
            values["reversed"] = not axis.reversed  # type: ignore[assignment]
        if values:
            axes[number, place] = values
    return tuple(changes_of(bench.config, axes)) if axes else ()
