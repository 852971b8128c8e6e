"""Lithium-ion battery: open-circuit voltage over charge, internal resistance, slow polarisation.

    V = cells · OCV(charge) · scale - v₁ - R₀ I        τ dv₁/dt = R₁ I - v₁

All consumers share the rail, so they sag together. Current fed back (negative) charges the battery;
the rest charges the capacitors on the rail.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.parameters import BatteryParameters
from native_kernels.compiled import borrows, compiled

OCV_V = np.array(
    [3.00, 3.55, 3.65, 3.70, 3.75, 3.80, 3.87, 3.95, 4.03, 4.11, 4.20],
)
"""Open-circuit voltage of a typical NMC cell at a charge of 0, 10, … 100 % [V]."""


@compiled
@borrows
def open_circuit_voltage(charge: float) -> float:
    """Open-circuit voltage of one cell [V], piecewise linear in the charge in [0, 1]."""
    position = min(max(charge, 0.0), 1.0) * 10.0
    i = min(int(position), 9)
    return float(OCV_V[i] + (position - i) * (OCV_V[i + 1] - OCV_V[i]))


@compiled
@borrows
def polarisation_step(
    polarisation_v: float, current_a: float, resistance_ohm: float, gain: float
) -> float:
    """Voltage over the RC pair after a step [V]; `gain` is 1 - exp(-dt/τ)."""
    return polarisation_v + (resistance_ohm * current_a - polarisation_v) * gain


@compiled
@borrows
def charge_step(charge: float, current_a: float, capacity_ah: float, dt_s: float) -> float:
    """Charge after a step with a current (positive discharges), limited to [0, 1]."""
    return min(max(charge - current_a * dt_s / (3600.0 * capacity_ah), 0.0), 1.0)


@compiled
@borrows
def rail_step(
    rail_v: float,
    quiet_v: float,
    load_a: float,
    battery_ohm: float,
    charge_max_a: float,
    rail_farad: float,
    dt_s: float,
) -> tuple[float, float]:
    """Return the battery's current [A], and the voltage of the capacitors above it [V].

    The second is 0 if the battery feeds the load or takes all feedback. `quiet_v` is the battery's
    voltage without a current.
    """
    left_v = rail_v - dt_s * (load_a + charge_max_a) / rail_farad
    if left_v > quiet_v + battery_ohm * charge_max_a:
        return -charge_max_a, left_v
    return max(load_a, -charge_max_a), 0.0


@compiled
@borrows
def resistor_current(
    rail_v: float,
    quiet_v: float,
    load_a: float,
    battery_ohm: float,
    charge_max_a: float,
    rail_farad: float,
    resistor_ohm: float,
    resistor_v: float,
    dt_s: float,
) -> float:
    """Mean current of a brake resistor that is switched to hold the rail at a voltage [A].

    It conducts permanently if that does not suffice.
    """
    battery_a, left_v = rail_step(
        rail_v, quiet_v, load_a, battery_ohm, charge_max_a, rail_farad, dt_s
    )
    excess_v = max(quiet_v - battery_ohm * battery_a, left_v) - resistor_v
    per_volt = rail_farad / dt_s if left_v > 0.0 else 1.0 / battery_ohm
    return min(max(excess_v, 0.0) * per_volt, rail_v / resistor_ohm)


class Battery:
    """A battery on its own; the plant runs the same compiled functions.

    Parameters
    ----------
    parameters
        Parameters of the battery.
    dt_s
        Step [s].
    """

    def __init__(self, parameters: BatteryParameters, dt_s: float = 1.0e-3) -> None:
        self._p = parameters
        self._dt = dt_s
        self.charge = parameters.charge
        self.polarisation_v = 0.0
        self.voltage_v = self._voltage(0.0)

    def step(self, current_a: float) -> float:
        """Advance by one step with a current [A], positive discharges; returns the voltage [V]."""
        p = self._p
        gain = -math.expm1(-self._dt / p.polarisation_time_s)
        self.polarisation_v = polarisation_step(
            self.polarisation_v, current_a, p.polarisation_resistance_ohm, gain
        )
        self.charge = charge_step(self.charge, current_a, p.capacity_ah, self._dt)
        self.voltage_v = self._voltage(current_a)
        return self.voltage_v

    def _voltage(self, current_a: float) -> float:
        p = self._p
        source = p.cells * open_circuit_voltage(self.charge) * p.voltage_scale
        return source - self.polarisation_v - p.internal_resistance_ohm * current_a
