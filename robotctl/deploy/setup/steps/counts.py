"""Step: counts and gear ratios, from ten turns of each wheel by hand, motors off."""

from __future__ import annotations

import math
from collections.abc import Generator
from fractions import Fraction
from typing import Any, Final

from robotctl.config.file_edit import Change, Key
from robotctl.config.patch import round_figures
from robotctl.deploy.setup.bench import Bench, Wheel
from robotctl.deploy.setup.dialogue import Answer, Ask, Changes, Kind, Script, Tell, Topic
from robotctl.deploy.setup.steps.asking import again_or_give_up, in_service
from robotctl.deploy.setup.wiring import axis_of, with_axis
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.errors import InvalidValue

TURNS: Final = 10
"""Turns by hand."""

ALIKE: Final = 0.02
"""Difference between counted and reported turns from turning by hand [share]."""

_LEAST_TURNS: Final = 0.02
"""Reported turns below which a wheel was not turned, or not reported."""
_SCALES: Final = ("pole_pairs", "counts_per_turn")
"""Keys of a table `[[motor]]` by which reported turns are divided."""
_FINE_PARTS: Final = 40
"""Maximum denominator of a ratio of small numbers."""


def run(bench: Bench) -> Script:
    """Compare reported turns with counted ones, and correct their factors."""
    yield from in_service(bench)
    yield Tell(
        f"Now each wheel is turned {TURNS} times forwards by hand, with the motors off: as it "
        "turns when the robot drives forwards."
    )
    changes: dict[Key, Change] = {}
    for wheel in bench.wheels:
        found, share = yield from _turn(bench, wheel)
        if found is not wheel:
            yield Tell(
                f"The axis of {found.name} reports it: the two seem to be swapped. The step "
                "`directions` puts that right."
            )
        elif share < 0.0:
            yield Tell(
                "It is reported backwards: the axis seems to be reversed. The step `directions` "
                "puts that right."
            )
        factor = abs(share)
        if abs(factor - 1.0) <= ALIKE:
            yield Tell(f"{wheel.name}: {TURNS * factor:.2f} turns reported, as it should be.")
            continue
        for change in (yield from _correct(bench, found, factor)):
            changes[change.key] = change
    return tuple(changes.values())


def _turn(bench: Bench, wheel: Wheel) -> Generator[Ask | Tell, Answer, tuple[Wheel, float]]:
    """Have a wheel turned; return the reported wheel, and reported over counted turns."""
    while True:
        before_rad = [each.angle_rad for each in bench.wheels]
        text = f"Turn the wheel {wheel.name} {TURNS} times forwards by hand, then press Enter."
        yield Ask(Topic.TURN, text, subject=wheel.name, loose=True)
        bench.rest(0.3, loose=True)
        turns = [
            (each.angle_rad - before) / math.tau
            for each, before in zip(bench.wheels, before_rad, strict=True)
        ]
        order = sorted(bench.wheels, key=lambda each: -abs(turns[each.place]))
        found = order[0]
        share = turns[found.place] / TURNS
        if abs(share) < _LEAST_TURNS:
            problem = f"no drive reports that {wheel.name} turned"
            remedy = "See that its encoder is connected, and that its drive tells it without power"
            yield from again_or_give_up(problem, remedy)
        elif len(order) > 1 and abs(turns[order[1].place]) > 0.2 * abs(turns[found.place]):
            problem = f"{found.name} and {order[1].name} are both reported to have turned"
            yield from again_or_give_up(problem, "Turn only one wheel")
        else:
            return found, share


def _correct(bench: Bench, wheel: Wheel, factor: float) -> Generator[Ask | Tell, Answer, Changes]:
    """Return the changes that correct a wheel's reported turns, too many by a factor."""
    drive = bench.config.drive
    number, place = axis_of(bench, wheel.name)
    motor = bench.config.motors[number]
    axis = motor.axes[place]
    words = f"{wheel.name}: {TURNS * factor:.2f} turns reported instead of {TURNS}"
    if not _takes_ratio(motor, place):
        counts = round(drive.counts_per_revolution * factor)
        key: Key = ("drive", "counts_per_revolution")
        yield Tell(f"{words}: {counts} counts per revolution, not {drive.counts_per_revolution}.")
        return (Change(key, counts),)
    ratio = _even(axis.ratio * factor)
    ways: dict[str, tuple[Key, Any, Any]] = {
        "ratio": (("motor", number, "axes", place, "ratio"), axis.ratio, ratio)
    }
    small = Fraction(factor).limit_denominator(_FINE_PARTS)
    for name in _SCALES:
        value = getattr(motor, name, 0)
        scaled = round(value * factor)
        if value and scaled and abs(value * factor / scaled - 1.0) <= ALIKE:
            ways = {name: (("motor", number, name), value, scaled), **ways}
    listed = ", or ".join(
        f"{name} = {new:g} instead of {old:g}" for name, (_, old, new) in ways.items()
    )
    yield Tell(f"{words}, a factor of {factor:.3f} (about {small}): {listed}.")
    chosen = "ratio"
    if len(ways) > 1:
        text = "Which of them is wrong in the file?"
        names = (*ways, "neither")
        chosen = str((yield Ask(Topic.SCALE, text, Kind.CHOICE, names, names[0], motor.name)))
    return (Change(ways[chosen][0], ways[chosen][2]),) if chosen in ways else ()


def _takes_ratio(motor: MotorConfig, place: int) -> bool:
    """Return whether a drive counts at the motor, so that a ratio leads to the wheel."""
    try:
        with_axis(motor, place, ratio=2.0 * motor.axes[place].ratio)
    except InvalidValue:
        return False
    return True


def _even(ratio: float) -> float:
    """Return a plausible ratio of gears: a whole number within the accuracy of turning by hand."""
    whole = round(ratio)
    if whole and abs(ratio / whole - 1.0) <= ALIKE / 2:
        return float(whole)
    return round_figures(ratio, 4)
