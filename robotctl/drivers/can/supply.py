"""The supply of a robot without a battery monitor, as its drives tell it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from robotctl.drivers.can.config import PowerConfig
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback
from robotctl.messages.control import BatteryFeedback

SAG_NS: Final = 2_000_000_000
"""Time for which a voltage may lie under a limit, as it does while motors accelerate [ns]."""


class DriveSupply:
    """Makes the battery's report of the drives' voltages, of which the lowest counts.

    Parameters
    ----------
    limits
        Voltages at which the battery is low, and critical.
    """

    def __init__(self, limits: PowerConfig) -> None:
        self._limits = limits
        self._stamp_ns = NEVER_NS
        self._low_ns = self._critical_ns = 0
        """When the voltage was last above each limit [ns]."""

    def update(self, reports: Sequence[ActuatorFeedback]) -> BatteryFeedback | None:
        """Return the supply report once every drive that has one has renewed it."""
        told = [(each.supply_ns, each.voltage_v) for each in reports if each.voltage_v is not None]
        stamp_ns = min((stamp_ns for stamp_ns, _ in told), default=NEVER_NS)
        if not told or stamp_ns == self._stamp_ns:
            return None
        voltage_v = min(voltage_v for _, voltage_v in told)
        if self._stamp_ns == NEVER_NS or voltage_v >= self._limits.low_v:
            self._low_ns = stamp_ns
        if self._stamp_ns == NEVER_NS or voltage_v >= self._limits.critical_v:
            self._critical_ns = stamp_ns
        self._stamp_ns = stamp_ns
        return BatteryFeedback(
            stamp_ns,
            voltage_v,
            current_a=math.nan,
            charge=math.nan,
            temperature_c=math.nan,
            low=stamp_ns - self._low_ns > SAG_NS,
            critical=stamp_ns - self._critical_ns > SAG_NS,
        )
