"""The current and speed loops of a drive, at the step of the plant.

A drive closes them at many times that rate, so the winding has the demanded current, as far as
current limit and supply allow, and the speed loop is implicit: its current is that of the speed
*after* the step. That is stable for any gains, however small the wheel's inertia.

Over one step the current is a line through its value at the speed before, i = start - slope ·
(ω - ω_before). The slope is that of the loop, that of the supply's limit, which is k/R, or none
where the current is limited. A limited current that could take the wheel beyond the speed at which
the loop demands none ends there: the line is the secant.
"""

from __future__ import annotations

import numpy as np

from firmware_sim.plant.axis import CURRENT
from firmware_sim.plant.plant_state import DT_S
from native_kernels.compiled import borrows, compiled


@compiled
@borrows
def loop_current(
    axes: np.ndarray, k: int, motor_constant: float, wheel_inertia: float, bus_v: float
) -> None:
    """Move the reference of axis k along its ramp, and set the line of its current."""
    a = axes[k]
    if a.mode == CURRENT:
        wanted, slope = a.demand, 0.0
    else:
        a.reference += min(max(a.demand - a.reference, -a.ramp), a.ramp)
        other = axes[int(a.sensor)]
        # The axes before this one have made their step.
        sensed = a.sense * (other.before if a.sensor < k else other.omega)
        gain = a.kp + a.ki * DT_S
        wanted = gain * (a.reference - sensed) + a.integral
        # A loop with the wrong speed feedback runs away explicitly.
        slope = gain if a.sensor == k and a.sense > 0.0 else 0.0
    limited = min(max(wanted, -a.current_max), a.current_max)
    top = a.voltage_share * bus_v
    high = (top - motor_constant * a.omega) / a.resistance
    low = (-top - motor_constant * a.omega) / a.resistance
    a.start = min(max(limited, low), high)
    a.saturated = 0.0
    if a.start != wanted:
        a.saturated = 1.0
        gained = 2.0 * DT_S * motor_constant * abs(a.start) / wheel_inertia
        secant = slope * max(a.start / wanted, 0.0) if wanted != 0.0 else 0.0
        slope = secant if slope * gained > abs(wanted) else 0.0
        if a.start != limited:
            slope = max(secant, motor_constant / a.resistance)
    a.slope = slope


@compiled
@borrows
def wind_up(axes: np.ndarray, k: int) -> None:
    """Integrate the speed loop's error, unless its demand exceeds a limit."""
    a = axes[k]
    if a.mode == CURRENT:
        return
    error = a.reference - a.sense * axes[int(a.sensor)].omega
    if a.saturated == 0.0 or error * a.integral < 0.0:
        integral = a.integral + a.ki * DT_S * error
        a.integral = min(max(integral, -a.current_max), a.current_max)
