"""PID controller with feed-forward, in the form that a sampled wheel loop needs.

Source: K. J. Astrom and R. M. Murray, *Feedback Systems*, 2nd ed., section 11.5 (implementation,
with back-calculation), and K. J. Astrom and T. Hagglund, *Advanced PID Control* (ISA 2006),
sections 3.4-3.5 and 13.3. With h the time step, r the set-point and y the measurement::

    s_k = (T_f s_(k-1) + y_k - y_(k-1)) / (T_f + h)         filtered slope of the measurement
    w_k = ff + k_p (r - y) + I_k - k_d s_k                  wanted output
    u_k = min(max(w_k, -limit), limit)
    I_(k+1) = I_k + h k_i (r - y) + min(h / T_t, 1) (u_k - w_k)

The derivative acts on the measurement only, so that a set-point step gives no kick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

from robotctl.errors import InvalidValue

FRICTION_BAND_RAD_S: Final = 0.02
"""Reference speed below which the friction feed-forward is proportional to it [rad/s]."""


@dataclass(frozen=True, slots=True)
class PidConfig:
    """Gains of a wheel-velocity loop: from rad/s to volts.

    Parameters
    ----------
    kp
        Proportional gain [V s/rad], >= 0.
    ki
        Integral gain [V/rad], >= 0. With 0 the integral state, which then holds only the rest of a
        bumpless gain change, decays with `tracking_s`.
    kd
        Derivative gain [V s^2/rad], >= 0, on the measurement.
    kv
        Feed-forward against back-EMF [V s/rad], >= 0.
    ks
        Feed-forward against Coulomb friction [V], >= 0.
    ka
        Feed-forward against inertia [V s^2/rad], >= 0.
    derivative_filter_s
        Time constant T_f of the derivative's first-order filter [s], >= 0; 0 is unfiltered.
    tracking_s
        Time constant T_t with which the integral follows a saturated output [s], >= 0. 0 chooses
        sqrt(kd/ki) with derivative, kp/ki without, at once if both are 0.

    Raises
    ------
    ValueError
        If a value is negative or not finite.
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    kv: float = 0.0
    ks: float = 0.0
    ka: float = 0.0
    derivative_filter_s: float = 0.0
    tracking_s: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidValue(
                    field.name, f"{value} found, a finite number >= 0 allowed", value
                )

    @property
    def can_drive(self) -> bool:
        """Whether it can drive at a speed: kd only damps, ks and ka hold no speed."""
        return self.kp > 0.0 or self.ki > 0.0 or self.kv > 0.0

    @property
    def effective_tracking_s(self) -> float:
        """Tracking time constant in use [s]: `tracking_s`, or the choice made for 0."""
        if self.tracking_s > 0.0:
            return self.tracking_s
        if self.ki == 0.0:
            return 0.0
        if self.kd > 0.0:
            return math.sqrt(self.kd / self.ki)
        return self.kp / self.ki


def feedforward_v(config: PidConfig, omega_ref_rad_s: float, alpha_ref_rad_s2: float) -> float:
    """Return the voltage [V] of a DC motor for a reference motion, kv w + ks sign(w) + ka a.

    The sign is replaced by w / `FRICTION_BAND_RAD_S` within that band, so that a reference near
    zero does not make the bridge chatter.
    """
    friction = omega_ref_rad_s / FRICTION_BAND_RAD_S
    if friction > 1.0:
        friction = 1.0
    elif friction < -1.0:
        friction = -1.0
    return config.kv * omega_ref_rad_s + config.ks * friction + config.ka * alpha_ref_rad_s2


class Pid:
    """The controller of the module's equations. It never raises after construction.

    The output is 0 V, with integral and slope held, if set-point, measurement or feed-forward is
    not finite, `limit` is negative or nan, or `dt_s` is not positive and finite. The slope restarts
    with the next good measurement, because the last difference is unknown.
    """

    __slots__ = (
        "_config",
        "_feedforward",
        "_integral",
        "_kd",
        "_ki",
        "_kp",
        "_measurement",
        "_slope",
        "_tf",
        "_tt",
        "_wanted_rest",
    )

    def __init__(self, config: PidConfig) -> None:
        self._load(config)
        self.reset()

    def _load(self, config: PidConfig) -> None:
        self._config = config
        self._kp = config.kp
        self._ki = config.ki
        self._kd = config.kd
        self._tf = config.derivative_filter_s
        self._tt = config.effective_tracking_s

    @property
    def config(self) -> PidConfig:
        """Gains in use."""
        return self._config

    @property
    def integral(self) -> float:
        """Integral state I [V]."""
        return self._integral

    def reset(self, measurement: float = 0.0) -> None:
        """Reset: integral 0, slope 0, `measurement` [rad/s] as the last one."""
        self._integral = 0.0
        self._slope = 0.0
        self._measurement = measurement if math.isfinite(measurement) else None
        self._wanted_rest = (0.0, 0.0, 0.0)

    def step(
        self, setpoint: float, measurement: float, dt_s: float, feedforward: float, limit: float
    ) -> float:
        """Return the output [V] for this tick.

        Parameters
        ----------
        setpoint, measurement
            Reference and measured speed [rad/s].
        dt_s
            Time since the last call [s], > 0.
        feedforward
            Voltage added to the output before it is limited [V].
        limit
            Maximum magnitude of the output [V], >= 0; may change from call to call.
        """
        error = setpoint - measurement
        proportional = self._kp * error
        # Written so that nan fails it: bad input gives 0 V and never an exception in the loop.
        if not (0.0 < dt_s < math.inf and limit >= 0.0 and math.isfinite(proportional)):
            self._measurement = None
            return 0.0
        last = self._measurement
        slope = self._slope
        if last is not None:
            slope = (self._tf * slope + measurement - last) / (self._tf + dt_s)
        wanted = feedforward + proportional + self._integral - self._kd * slope
        if not math.isfinite(wanted):
            self._measurement = None
            return 0.0
        output = wanted
        if wanted > limit:
            output = limit
        elif wanted < -limit:
            output = -limit
        self._integrate(error, dt_s, output - wanted)
        self._measurement = measurement
        self._slope = slope
        self._wanted_rest = (error, slope, feedforward)
        return output

    def _integrate(self, error: float, dt_s: float, excess: float) -> None:
        """Advance the integral; `excess` is limited minus wanted output [V]."""
        # A step longer than the tracking time would overshoot the back-calculation.
        share = dt_s / self._tt if self._tt > dt_s else 1.0
        if self._ki > 0.0:
            integral = self._integral + dt_s * self._ki * error + share * excess
        else:
            # Without ki the state only holds the rest of a bumpless gain change; let it decay.
            integral = self._integral * (1.0 - share)
        if math.isfinite(integral):
            self._integral = integral

    def set_gains(self, config: PidConfig, feedforward: float | None = None) -> None:
        """Change the gains without a bump: the output for the last inputs stays the same.

        The integral takes up the difference of the other terms.

        Parameters
        ----------
        config
            New gains.
        feedforward
            Feed-forward of the new gains for the last set-point [V], if the caller computes it from
            them; None if it does not change.
        """
        error, slope, feedforward_last = self._wanted_rest
        change = (self._kp - config.kp) * error - (self._kd - config.kd) * slope
        if feedforward is not None:
            change += feedforward_last - feedforward
            feedforward_last = feedforward
        if math.isfinite(change):
            self._integral += change
        self._wanted_rest = (error, slope, feedforward_last)
        self._load(config)
