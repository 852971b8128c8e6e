"""One axis of a drive: from the motor's quantities to those of the wheel, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue
from robotctl.model.actuators import Takes

RATIO_MAX = 1000.0
"""Greatest gear ratio, and the inverse of the least: beyond, a setting is a slip."""


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """One axis of a motor drive, and what it turns.

    Parameters
    ----------
    actuator
        Name of the wheel or joint.
    axis
        Number of the axis on the drive, from 1.
    reversed
        Whether the motor's positive direction drives the wheel backwards.
    ratio
        Turns of the motor for one of the wheel, > 0.
    """

    actuator: str
    axis: int = 1
    reversed: bool = False
    ratio: float = 1.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 1 <= self.axis <= 8:
            raise InvalidValue("axis", f"must be 1 to 8, not {self.axis}", self.axis)
        if not 1.0 / RATIO_MAX <= self.ratio <= RATIO_MAX:
            raise InvalidValue(
                "ratio", f"must be {1 / RATIO_MAX:g} to {RATIO_MAX:g}, not {self.ratio}", self.ratio
            )


class Axis:
    """Converts between a motor and its wheel or joint.

    Parameters
    ----------
    config
        What hangs on it, and how.
    takes
        What a command for it is.
    ticks_per_revolution
        Unit of the wheel's position; 0 for a joint.

    Attributes
    ----------
    number
        Number of the axis on the drive, from 1.
    name
        Name of the wheel or joint.
    takes
        What a command for it is.
    ticks_per_revolution
        Unit of the wheel's position; 0 for a joint.
    """

    __slots__ = (
        "_motor_per_wheel",
        "_ticks_per_turn",
        "_wheel_per_motor",
        "name",
        "number",
        "takes",
        "ticks_per_revolution",
    )

    def __init__(self, config: AxisConfig, takes: Takes, ticks_per_revolution: int) -> None:
        self.number = config.axis
        self.name = config.actuator
        self.takes = takes
        self.ticks_per_revolution = ticks_per_revolution
        self._motor_per_wheel = math.copysign(config.ratio, -1.0 if config.reversed else 1.0)
        self._wheel_per_motor = 1.0 / self._motor_per_wheel
        self._ticks_per_turn = ticks_per_revolution * self._wheel_per_motor

    def to_motor(self, speed_rad_s: float) -> float:
        """Return the motor's speed for one of the wheel, in the same unit; angles likewise."""
        return speed_rad_s * self._motor_per_wheel

    def to_wheel(self, speed_rad_s: float) -> float:
        """Return the wheel's speed for one of the motor, in the same unit; angles likewise."""
        return speed_rad_s * self._wheel_per_motor

    def current_a(self, motor_a: float) -> float:
        """Return a motor's current with the sign of the wheel's torque [A]."""
        return math.copysign(1.0, self._motor_per_wheel) * motor_a

    def ticks(self, motor_turns: float) -> int:
        """Return the wheel's position [tick] for turns of the motor since any time."""
        return math.floor(motor_turns * self._ticks_per_turn)


class Unwrapped:
    """A counter of a drive that rolls over, as one that does not.

    Parameters
    ----------
    bits
        Width of the counter.

    Attributes
    ----------
    value
        Counts since the first reading was 0 or above, unbounded.
    """

    __slots__ = ("_half", "_span", "value")

    def __init__(self, bits: int) -> None:
        self._span = 1 << bits
        self._half = self._span >> 1
        self.value = 0

    def update(self, counter: int) -> int:
        """Return the unbounded value of a reading; each step must be under half the range."""
        step = (counter - self.value) % self._span
        self.value += step - self._span if step >= self._half else step
        return self.value
