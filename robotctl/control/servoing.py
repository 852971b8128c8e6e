"""Servoing: proportional control of any sensor reading, with its sign and its stability stated.

Often printed as v = -kp (z_desired - z_actual). Whether that is negative feedback
depends on what a positive demand does to the reading, so here this is a parameter::

    demand = direction * kp * (z_ref - z),    limited to +-limit

with direction = +1 where a positive demand raises the reading (angle of the own camera on a pan
joint) and -1 where it lowers it (distance ahead under forward speed, the case of that formula).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class ServoConfig:
    """A proportional servo.

    Parameters
    ----------
    kp
        Gain, > 0 [demand unit / reading unit].
    direction
        +1 where a positive demand raises the reading, -1 where it lowers it.
    limit
        Largest magnitude of the demand, > 0; inf for none.
    tolerance
        Errors up to this give no demand, >= 0 [reading unit].

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    kp: float
    direction: Literal[1, -1]
    limit: float = math.inf
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.kp < math.inf:
            raise ValueError(f"kp: {self.kp} found, a finite number > 0 allowed")
        if self.direction not in (1, -1):
            raise ValueError(f"direction: {self.direction} found, 1 or -1 allowed")
        if not self.limit > 0.0:
            raise ValueError(f"limit: {self.limit} found, a number > 0 allowed")
        if not 0.0 <= self.tolerance < math.inf:
            raise ValueError(f"tolerance: {self.tolerance} found, a finite number >= 0 allowed")


def servo(config: ServoConfig, reading_ref: float, reading: float) -> float:
    """Return the demand that brings a reading to its reference; 0 if one is not finite."""
    error = reading_ref - reading
    if not math.isfinite(error) or abs(error) <= config.tolerance:
        return 0.0
    demand = config.direction * config.kp * error
    if demand > config.limit:
        return config.limit
    if demand < -config.limit:
        return -config.limit
    return demand


def gain_limit(plant_gain: float, dt_s: float, delay_steps: int) -> float:
    """Return the gain at which servoing on an integrating plant becomes unstable.

    Plant: z_(k+1) = z_k + plant_gain * dt * demand_(k - d). With loop gain K = kp plant_gain dt
    the characteristic equation is x^(d+1) - x^d + K = 0, stable if and only if
    0 < K < 2 sin(pi / (2 (2 d + 1))). Without delay K < 2, with one step K < 1.

    Source: S. A. Levin and R. M. May, "A note on difference-delay equations", Theoretical
    Population Biology 9 (1976).

    Parameters
    ----------
    plant_gain
        Size of the reading's rate for a demand of 1, > 0 [reading unit / s / demand unit].
    dt_s
        Period of the loop [s], > 0.
    delay_steps
        Whole periods d from a reading to the demand's effect, beyond the one that any sampled
        loop has, >= 0.

    Raises
    ------
    ValueError
        If a parameter is outside its range.
    """
    unit = _unit_gain(plant_gain, dt_s, delay_steps)
    return 2.0 * math.sin(math.pi / (2.0 * (2 * delay_steps + 1))) / unit


def gain_without_overshoot(plant_gain: float, dt_s: float, delay_steps: int) -> float:
    """Return the largest gain whose response does not swing: a double real pole.

    Same plant and parameters as `gain_limit`: x^d (1 - x) has its maximum d^d / (d+1)^(d+1) at
    x = d / (d + 1), so K must not exceed it. Without delay K <= 1, with one step K <= 1/4.

    Raises
    ------
    ValueError
        If a parameter is outside its range.
    """
    unit = _unit_gain(plant_gain, dt_s, delay_steps)
    d = delay_steps
    return float(d**d) / float((d + 1) ** (d + 1)) / unit


def _unit_gain(plant_gain: float, dt_s: float, delay_steps: int) -> float:
    """Return the loop gain K of kp = 1, after a check of the parameters."""
    for name, value in (("plant_gain", plant_gain), ("dt_s", dt_s)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name}: {value} found, a finite number > 0 allowed")
    if delay_steps < 0:
        raise ValueError(f"delay_steps: {delay_steps} found, a number >= 0 allowed")
    return plant_gain * dt_s
