"""Tolerances of the plausibility monitors whose bounds are met exactly: sums of powers of two."""

import math

from robotctl.safety.plausibility_config import PlausibilityConfig

MS = 1_000_000
T0 = 1_000_000_000
DEADBAND = 0.25
CONFIG = PlausibilityConfig(
    resistance_ohm=2.0,
    back_emf_v_s_rad=0.5,
    speed_tolerance_rad_s=2.0,
    speed_tolerance_share=0.25,
    speed_ms=50,
    push_v=1.5,
    push_ms=300,
    pair_share=0.125,
    pair_ms=1000,
    steering_tolerance_rad=0.25,
    steering_ms=600,
    clock_share=0.03,
)


def below(value: float) -> float:
    """The next number down."""
    return math.nextafter(value, -math.inf)


def above(value: float) -> float:
    """The next number up."""
    return math.nextafter(value, math.inf)
