"""Brushed DC motor with gearbox: winding, torque, friction and heat, seen from the wheel.

All functions work over one step in which the wheel's speed changes little against the step's
length; the winding's current is integrated exactly for a voltage and a mean speed constant over
the step, so the step may be as long as or longer than L/R. They are compiled, and shared by the
plant and by `Motor`, a motor on its own with a load, on which the closed forms are tested.

With k = gear_ratio · back_emf, seen at the wheel:

    L di/dt = V - R i - k ω        J dω/dt = k i - B ω - friction
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.parameters import MotorParameters
from native_kernels.compiled import borrows, compiled

COPPER_PER_K = 0.00393
"""Rise of a copper winding's resistance per kelvin, relative to its value at 20 °C."""

STRIBECK_RAD_S = 0.2
"""Speed of the wheel at which the excess of static over sliding friction has halved."""


@compiled
@borrows
def winding_resistance(resistance_20c: float, temperature_c: float) -> float:
    """Resistance of a copper winding at a temperature [ohm]."""
    return resistance_20c * (1.0 + COPPER_PER_K * (temperature_c - 20.0))


@compiled
@borrows
def current_decay(resistance: float, inductance: float, dt_s: float) -> tuple[float, float]:
    """Shares of the initial current in the current after a step and in its mean over the step.

    After the step i₁ = e·i₀ + (1-e)·i∞, on average ī = a·i₀ + (1-a)·i∞, with i∞ = (V - kω)/R.
    Without inductance both shares are 0.
    """
    x = resistance * dt_s / inductance if inductance > 0.0 else np.inf
    e = math.exp(-x)
    return e, (1.0 - e) / x


@compiled
@borrows
def chopped_voltage(
    voltage: float,
    bus_v: float,
    emf_v: float,
    current: float,
    resistance: float,
    decay: float,
    limit_a: float,
) -> float:
    """Voltage that keeps the current after the step within the bridge's current limit [V].

    The bridge gives at most ±`bus_v`, so a motor that is driven fast from outside may still exceed
    the limit.
    """
    high = emf_v + resistance * (limit_a - decay * current) / (1.0 - decay)
    low = emf_v + resistance * (-limit_a - decay * current) / (1.0 - decay)
    return min(max(min(max(voltage, low), high), -bus_v), bus_v)


@compiled
@borrows
def friction_torque(
    speed: float, torque: float, coulomb: float, stiction_ratio: float, gear_loss: float
) -> float:
    """Maximum friction at the wheel [N m]: Coulomb with static excess, and the gear's loss."""
    excess = (stiction_ratio - 1.0) / (1.0 + (speed / STRIBECK_RAD_S) ** 2)
    return coulomb * (1.0 + excess) + gear_loss * abs(torque)


@compiled
@borrows
def wheel_step(
    speed: float,
    drive_torque: float,
    friction: float,
    damping: float,
    inertia: float,
    dt_s: float,
) -> tuple[float, float]:
    """Speed of the wheel after a step without load, and the inertia that a load impulse meets.

    `damping` (back-EMF and viscous) acts on the mean of the speeds before and after, so the step
    is stable however stiff the motor; `friction` stops the wheel but never reverses it.

    Returns
    -------
    tuple
        Speed [rad/s]; effective inertia [kg m²].
    """
    effective = inertia + 0.5 * dt_s * damping
    momentum = inertia * speed + dt_s * (drive_torque - 0.5 * damping * speed)
    stop = friction * dt_s
    if momentum > stop:
        momentum -= stop
    elif momentum < -stop:
        momentum += stop
    else:
        momentum = 0.0
    return momentum / effective, effective


@compiled
@borrows
def heat_step(
    power_w: float,
    winding_c: float,
    case_c: float,
    winding_heat: float,
    case_heat: float,
    winding_to_case: float,
    case_to_air: float,
    air_c: float,
    dt_s: float,
) -> tuple[float, float]:
    """Temperatures of winding and case after a step [°C]; heats in J/K, resistances in K/W."""
    to_case = (winding_c - case_c) / winding_to_case
    to_air = (case_c - air_c) / case_to_air
    return (
        winding_c + dt_s * (power_w - to_case) / winding_heat,
        case_c + dt_s * (to_case - to_air) / case_heat,
    )


class Motor:
    """A motor on its own, with a fixed load inertia at the wheel and an ideal supply.

    The plant, which couples several motors to battery and floor, runs the same compiled functions,
    so tests of this class apply to it.

    Parameters
    ----------
    parameters
        Parameters of the motor.
    load_kg_m2
        Inertia at the wheel in addition to the rotor's [kg m²].
    dt_s
        Step [s].
    """

    def __init__(
        self, parameters: MotorParameters, load_kg_m2: float = 0.0, dt_s: float = 1.0e-3
    ) -> None:
        self._p = parameters
        self._dt = dt_s
        self._inertia = load_kg_m2 + parameters.rotor_inertia_kg_m2 * parameters.gear_ratio**2
        self.speed_rad_s = 0.0
        self.current_a = 0.0
        self.winding_c = parameters.air_c
        self.case_c = parameters.air_c
        self.supplied_j = 0.0
        self.copper_loss_j = 0.0

    @property
    def inertia_kg_m2(self) -> float:
        """Rotor and load, at the wheel [kg m²]."""
        return self._inertia

    def step(self, voltage_v: float, bus_v: float, load_n_m: float = 0.0) -> None:
        """Advance by one step with a voltage [V], limited by a supply [V], against a load [N m]."""
        p, dt = self._p, self._dt
        k = p.gear_ratio * p.back_emf_v_s_rad
        resistance = winding_resistance(p.resistance_ohm, self.winding_c)
        decay, held = current_decay(resistance, p.inductance_h, dt)
        voltage = chopped_voltage(
            voltage_v,
            bus_v,
            k * self.speed_rad_s,
            self.current_a,
            resistance,
            decay,
            p.current_limit_a,
        )
        torque = k * (held * self.current_a + (1.0 - held) * voltage / resistance)
        damping = (1.0 - held) * k * k / resistance + p.viscous_n_m_s_rad * p.gear_ratio**2
        friction = friction_torque(
            self.speed_rad_s,
            torque - (1.0 - held) * k * k / resistance * self.speed_rad_s,
            p.coulomb_n_m * p.gear_ratio,
            p.stiction_ratio,
            1.0 - p.gear_efficiency,
        )
        before = self.speed_rad_s
        self.speed_rad_s, _ = wheel_step(
            before, torque - load_n_m, friction, damping, self._inertia, dt
        )
        final = (voltage - 0.5 * k * (before + self.speed_rad_s)) / resistance
        mean = held * self.current_a + (1.0 - held) * final
        self.current_a = decay * self.current_a + (1.0 - decay) * final
        loss = mean * mean * resistance
        self.supplied_j += voltage * mean * dt
        self.copper_loss_j += loss * dt
        self.winding_c, self.case_c = heat_step(
            loss,
            self.winding_c,
            self.case_c,
            p.winding_heat_j_k,
            p.case_heat_j_k,
            p.winding_to_case_k_w,
            p.case_to_air_k_w,
            p.air_c,
            dt,
        )
