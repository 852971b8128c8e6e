"""Parameters of faults: allowed values, and their form in messages."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from firmware_sim.errors import SimulationError, nearest

Value: TypeAlias = str | float
Arguments: TypeAlias = Mapping[str, Value]
Undo: TypeAlias = Callable[[], None]
"""Ends a fault that lasts."""

DURATION: Final = "duration"

FAILED: Final = " failed: "
"""Text between a fault of a scenario and why it could not begin."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a kind of fault: a number in its range, one of some words, or a name.

    Attributes
    ----------
    default
        Value if none is given.
    help
        Unit, and meaning where the name is not clear.
    low, high
        Bounds of a number, inclusive.
    words
        Allowed words of a parameter that is not a number.
    whole
        Whether it must be a whole number.
    named
        Whether it is a name, which only the robot can check.
    """

    default: Value
    help: str
    low: float = 0.0
    high: float = 0.0
    words: tuple[str, ...] = ()
    whole: bool = False
    named: bool = False

    @property
    def bounds(self) -> str:
        """Minimum and maximum, in words."""
        digits = ".0f" if self.whole else "g"
        return f"{self.low:{digits}} to {self.high:{digits}}"

    def value(self, given: object) -> Value:
        """Return a given value converted; a number may be text, hexadecimal with `0x`.

        Raises
        ------
        SimulationError
            If it is not allowed; names the allowed values.
        """
        if self.named and isinstance(given, str):
            return given
        if self.words:
            if not isinstance(given, str) or given not in self.words:
                hint = nearest(str(given), self.words)
                raise SimulationError(
                    f"{reprlib.repr(given)}, allowed: {', '.join(self.words)}{hint}"
                )
            return given
        number = _number(given)
        if self.whole and not number.is_integer():
            raise SimulationError(f"{number:g} is no whole number")
        if not self.low <= number <= self.high:
            found = f"{number:.0f}" if self.whole else f"{number:g}"
            raise SimulationError(f"{found}, allowed: {self.bounds}")
        return number


def shown(key: str) -> str:
    """Return a key as a message shows it: on one line, and shortened where it is very long."""
    return reprlib.repr(key)[1:-1]


def _number(given: object) -> float:
    try:
        if isinstance(given, str) and given.startswith("0x"):
            return float(int(given, 16))
        if isinstance(given, str | int | float) and not isinstance(given, bool):
            return float(given)
    except (ValueError, OverflowError):
        pass
    raise SimulationError(f"{reprlib.repr(given)} is no number")
