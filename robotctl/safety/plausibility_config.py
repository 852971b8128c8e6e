"""How far inputs may contradict each other: settings of the monitors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class PlausibilityConfig:
    """How far inputs may contradict each other.

    Parameters
    ----------
    resistance_ohm
        Of one motor's winding and leads at 25 degC [ohm], > 0: measure it at the terminals.
    back_emf_v_s_rad
        Voltage at the motor's terminals per speed of the wheel, without load [V s/rad], > 0: from
        the data sheet, times the gear ratio. Not the loop's `kv`, so that tuning cannot blind it.
    speed_tolerance_rad_s, speed_tolerance_share
        The encoder may differ from the speed given by duty and current by the sum of the first
        [rad/s] and of the second times the greater of the two, > 0, at most 5 and 0.5. Slow motors
        need less, coarse encoders more: see docs/safety.md.
    speed_ms
        Longer than this it may not [ms], 5 to 500; half as long if it differs twice as much, since
        a loop with swapped encoders accelerates more the faster it is.
    push_v
        Drop `R i` over a winding [V], > 0, at most 10; more than the steepest slope needs.
    push_ms
        Maximum time above it without speed in that direction [ms], 20 to 2000: without 3 rad/s, or
        a third of what `limits.a_max_m_s2` gives in this time.
    pair_share
        Two wheels may differ by this in the ratio of counted to electrical speed, > 0, at most 0.5.
    pair_ms
        Longer than this they may not [ms], 20 to 5000.
    steering_tolerance_rad
        The steering may differ from its command by this [rad], > 0, at most 0.5, and below the
        bound of the linkage.
    steering_ms
        Longer than this it may not [ms]; more than full travel takes, 20 to 2000.
    clock_share
        The drive's clock may be faster or slower than the host's by this, > 0, at most 0.25.
    follow_ms
        Longest time for which a wheel whose drive closes its own loop may be off its commanded
        speed by more than the tolerances of speed [ms], 50 to 2000. One that is faster than its
        command or turns against it has `speed_ms`.
    travel_m
        Way straight ahead over which a sonar that looks along it is compared [m], > 0, at most 2.

    Raises
    ------
    ValueError
        If a value is out of its range: a tolerance that nothing exceeds is no monitor.
    """

    resistance_ohm: float | None = None
    back_emf_v_s_rad: float | None = None
    speed_tolerance_rad_s: float = 2.0
    speed_tolerance_share: float = 0.25
    speed_ms: int = 50
    push_v: float = 1.5
    push_ms: int = 300
    pair_share: float = 0.15
    pair_ms: int = 1000
    steering_tolerance_rad: float = 0.35
    steering_ms: int = 600
    clock_share: float = 0.03
    travel_m: float = 0.3
    follow_ms: int = 400

    @property
    def motor(self) -> tuple[float, float]:
        """Resistance [ohm] and back-EMF [V s/rad] of a motor whose drive takes a duty."""
        if self.resistance_ohm is None or self.back_emf_v_s_rad is None:
            raise ValueError("resistance_ohm, back_emf_v_s_rad: missing for wheels with a duty")
        return self.resistance_ohm, self.back_emf_v_s_rad

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, most in _MOST.items():
            value = getattr(self, name)
            if value is None:
                continue
            if not 0.0 < value < math.inf:
                raise InvalidValue(name, f"{value} found, a finite number > 0 allowed", value)
            if value > most:
                raise InvalidValue(name, f"{value} found, at most {most} allowed", value)
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise InvalidValue(name, f"{value} found, {low} to {high} allowed", value)


OF_DUTY_WHEELS: Final = ("resistance_ohm", "back_emf_v_s_rad")
"""Keys that robots need whose drives take a duty."""

_MOST: Final = {
    "resistance_ohm": math.inf,
    "back_emf_v_s_rad": math.inf,
    "speed_tolerance_rad_s": 5.0,
    "speed_tolerance_share": 0.5,
    "push_v": 10.0,
    "pair_share": 0.5,
    "steering_tolerance_rad": 0.5,
    "clock_share": 0.25,
    "travel_m": 2.0,
}
_RANGES: Final = {
    "speed_ms": (5, 500),
    "push_ms": (20, 2000),
    "pair_ms": (20, 5000),
    "steering_ms": (20, 2000),
    "follow_ms": (50, 2000),
}
