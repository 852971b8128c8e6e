"""Duty of the bridge from a motor voltage.

The motor gets `bus_voltage * e`, where the bridge with a dead-band b turns a duty d into the
effective duty ``e = sign(d) max(0, |d| - b) / (1 - b)``. This module applies the inverse,
``d = sign(e) (b + (1 - b) |e|)``, so that the effective voltage is linear in the demand, and
limits e in size and slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue

ZERO_DUTY: Final = 0.5e-4
"""Effective duty below which the output is 0: half the resolution of the duty signals on CAN."""


@dataclass(frozen=True, slots=True)
class PwmConfig:
    """Properties of one bridge.

    Parameters
    ----------
    deadband
        Duty up to which the motor gets no voltage, [0, 1).
    slew_per_s
        Maximum change of the effective duty [1/s], > 0; inf for no limit.
    max_duty
        Maximum magnitude of the duty, (deadband, 1].
    min_bus_voltage_v
        Floor of the supply voltage in the compensation [V], > 0; below it the duty stops growing.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    deadband: float = 0.0
    slew_per_s: float = 40.0
    max_duty: float = 1.0
    min_bus_voltage_v: float = 6.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.deadband < 1.0:
            raise InvalidValue("deadband", f"{self.deadband} found, [0, 1) allowed", self.deadband)
        if not self.slew_per_s > 0.0:
            raise InvalidValue(
                "slew_per_s", f"{self.slew_per_s} found, a number > 0 allowed", self.slew_per_s
            )
        if not self.deadband < self.max_duty <= 1.0:
            raise InvalidValue(
                "max_duty",
                f"{self.max_duty} found, ({self.deadband}, 1] allowed (above deadband)",
                self.max_duty,
            )
        if not 0.0 < self.min_bus_voltage_v < math.inf:
            raise InvalidValue(
                "min_bus_voltage_v",
                f"{self.min_bus_voltage_v} found, a finite number > 0 allowed",
                self.min_bus_voltage_v,
            )


class PwmMap:
    """Maps voltages to duties; stores the last effective duty for the slew limit."""

    __slots__ = ("_deadband", "_effective", "_floor_v", "_max_effective", "_slew_per_s")

    def __init__(self, config: PwmConfig) -> None:
        self._deadband = config.deadband
        self._slew_per_s = config.slew_per_s
        self._max_effective = (config.max_duty - config.deadband) / (1.0 - config.deadband)
        self._floor_v = config.min_bus_voltage_v
        self._effective = 0.0

    def reset(self) -> None:
        """Assume zero output, as after the bridge was off."""
        self._effective = 0.0

    def voltage_limit_v(self, bus_voltage_v: float) -> float:
        """Return the maximum motor voltage [V]: the `limit` of the PID before it.

        0 if the bus voltage is unknown (not finite or not positive), as in `step`.
        """
        if not 0.0 < bus_voltage_v < math.inf:
            return 0.0
        floor_v = self._floor_v
        return self._max_effective * (bus_voltage_v if bus_voltage_v > floor_v else floor_v)

    def step(self, voltage_v: float, bus_voltage_v: float, dt_s: float) -> float:
        """Return the duty [-max_duty, max_duty] for a demanded mean motor voltage.

        The duty is 0 at once, and the slew limit starts from there, if an argument is not finite,
        or bus voltage or `dt_s` is not positive.

        Parameters
        ----------
        voltage_v
            Demanded voltage [V], positive forwards.
        bus_voltage_v
            Supply of the bridge [V].
        dt_s
            Time since the last call [s].
        """
        if not (0.0 < bus_voltage_v < math.inf and 0.0 < dt_s < math.inf) or not math.isfinite(
            voltage_v
        ):
            self._effective = 0.0
            return 0.0
        # Divide by the present supply, so that a flat battery changes no gain; the floor keeps a
        # sagging one from raising the duty without bound.
        effective = voltage_v / (bus_voltage_v if bus_voltage_v > self._floor_v else self._floor_v)
        top = self._max_effective
        if effective > top:
            effective = top
        elif effective < -top:
            effective = -top
        last = self._effective
        change = self._slew_per_s * dt_s
        if effective > last + change:
            effective = last + change
        elif effective < last - change:
            effective = last - change
        self._effective = effective
        if effective > ZERO_DUTY:
            return self._deadband + (1.0 - self._deadband) * effective
        if effective < -ZERO_DUTY:
            return -self._deadband + (1.0 - self._deadband) * effective
        return 0.0
