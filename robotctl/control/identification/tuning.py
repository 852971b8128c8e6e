"""PI and PID gains from a measured model or from a relay experiment.

All gains are in the units of `PidConfig`: with a process from volts to rad/s, kp in V s/rad, ki in
V/rad, kd in V s^2/rad. For a controller Kc (1 + 1 / (Ti s) + Td s) they are Kc, Kc / Ti, Kc Td.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robotctl.control.identification.identification import FirstOrderModel


class PidGains(NamedTuple):
    """Feedback gains in the units of `PidConfig`."""

    kp: float
    ki: float
    kd: float = 0.0


def simc_pi(model: FirstOrderModel, closed_loop_s: float | None = None) -> PidGains:
    """Return Skogestad's PI gains.

    Kc = tau / (K (tau_c + theta)) and Ti = min(tau, 4 (tau_c + theta)).

    Source: S. Skogestad, "Simple analytic rules for model reduction and PID controller tuning",
    Journal of Process Control 13 (2003). His choice tau_c = theta gives a gain margin of about 3.

    Parameters
    ----------
    model
        The process; its gain and time constant must be positive.
    closed_loop_s
        Desired time constant tau_c of the closed loop [s], >= 0; None: theta.

    Raises
    ------
    ValueError
        If gain or time constant is not positive, or tau_c + theta is 0.
    """
    tau_c = model.delay_s if closed_loop_s is None else closed_loop_s
    kc = _lag_gain(model, tau_c)
    return PidGains(kc, kc / min(model.time_constant_s, 4.0 * (tau_c + model.delay_s)))


def _lag_gain(model: FirstOrderModel, closed_loop_s: float) -> float:
    """Return tau / (K (tau_c + theta)); raises ValueError as `simc_pi`."""
    if not (model.gain > 0.0 and model.time_constant_s > 0.0 and model.delay_s >= 0.0):
        raise ValueError(f"model: {model} found, gain and time constant > 0, delay >= 0 allowed")
    if not (closed_loop_s >= 0.0 and 0.0 < closed_loop_s + model.delay_s < math.inf):
        raise ValueError(
            f"closed_loop_s: {closed_loop_s} found with delay {model.delay_s}, sum > 0 allowed"
        )
    return model.time_constant_s / (model.gain * (closed_loop_s + model.delay_s))


class Relay:
    """The relay of the experiment: +-amplitude round a bias, switching with hysteresis.

    Source: K. J. Astrom and T. Hagglund, "Automatic tuning of simple regulators with
    specifications on phase and amplitude margins", Automatica 20(5), 1984.

    Parameters
    ----------
    amplitude
        Half the height d of the relay, > 0 [V].
    hysteresis
        Half the width epsilon of the hysteresis, >= 0 [rad/s]; above the noise.
    bias
        Middle of the output [V], about the voltage at the set-point.

    Raises
    ------
    ValueError
        If a parameter is outside its range.
    """

    def __init__(self, amplitude: float, hysteresis: float = 0.0, bias: float = 0.0) -> None:
        if not 0.0 < amplitude < math.inf:
            raise ValueError(f"amplitude: {amplitude} found, a finite number > 0 allowed")
        if not 0.0 <= hysteresis < math.inf:
            raise ValueError(f"hysteresis: {hysteresis} found, a finite number >= 0 allowed")
        self.amplitude = amplitude
        self.hysteresis = hysteresis
        self.bias = bias
        self.reset()

    def reset(self) -> None:
        """Restart with the high output."""
        self._high = True

    def step(self, setpoint: float, measurement: float) -> float:
        """Return the output [V]; only the bias if an argument is not finite."""
        error = setpoint - measurement
        if not math.isfinite(error):
            return self.bias
        if error > self.hysteresis:
            self._high = True
        elif error < -self.hysteresis:
            self._high = False
        return self.bias + (self.amplitude if self._high else -self.amplitude)


@dataclass(frozen=True, slots=True)
class Oscillation:
    """A steady oscillation: period [s], amplitude (half of peak to peak), and cycles measured."""

    period_s: float
    amplitude: float
    cycles: int


def measure_oscillation(
    time_s: ArrayLike, response: ArrayLike, skip_cycles: int = 2
) -> Oscillation:
    """Return period and amplitude of the oscillation in a relay experiment's record.

    They are medians over the cycles, so that a disturbed one does no harm.

    Parameters
    ----------
    time_s, response
        The record, shape (n,) each, times increasing [s].
    skip_cycles
        Cycles to skip at the beginning, >= 0.

    Raises
    ------
    ValueError
        If fewer than three cycles are left, or the last ones differ from each other by more than
        a quarter: no steady oscillation.
    """
    t, y = np.asarray(time_s, dtype=np.float64), np.asarray(response, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape:
        raise ValueError(f"record: shapes {t.shape} and {y.shape} found, (n,) for both allowed")
    late = y[t >= 0.5 * (t[0] + t[-1])]
    middle, swing = 0.5 * (late.max() + late.min()), 0.5 * (late.max() - late.min())
    starts = _rises(t, y, middle, 0.25 * swing)[skip_cycles:]
    if len(starts) < 4:
        raise ValueError(f"record: {max(0, len(starts) - 1)} cycles found, at least 3 needed")
    periods = np.diff(starts)
    heights = np.array(
        [np.ptp(y[(t >= begin) & (t < end)]) for begin, end in itertools.pairwise(starts)]
    )
    last = heights[len(heights) // 2 :]
    if last.max() > 1.25 * last.min() + 1e-12:
        raise ValueError("record: the oscillation is not steady")
    return Oscillation(float(np.median(periods)), 0.5 * float(np.median(heights)), len(periods))


def _rises(
    t: NDArray[np.float64], y: NDArray[np.float64], middle: float, noise: float
) -> list[float]:
    """Return the times at which y rises through the middle, interpolated.

    It must come from below `middle - noise` and continue above `middle + noise`.
    """
    rises: list[float] = []
    armed = False
    rise = 0.0
    for i in range(1, y.size):
        if y[i - 1] < middle <= y[i]:
            share = (middle - y[i - 1]) / (y[i] - y[i - 1])
            rise = float(t[i - 1] + share * (t[i] - t[i - 1]))
        if y[i] < middle - noise:
            armed = True
        elif armed and y[i] > middle + noise:
            armed = False
            rises.append(rise)
    return rises


class UltimatePoint(NamedTuple):
    """Gain at which a proportional loop would just oscillate [V s/rad], and its period [s]."""

    gain: float
    period_s: float


def ultimate_point(relay: Relay, oscillation: Oscillation) -> UltimatePoint:
    """Return Ku and Tu by the describing function: Ku = 4 d / (pi sqrt(a^2 - epsilon^2)).

    An approximation, since it neglects the harmonics. For a first-order process with dead time Ku
    comes out between a fifth too low (delay short against the time constant, where
    Ku = 4 tau / (pi K theta) instead of pi tau / (2 K theta)) and a quarter too high (long).

    Raises
    ------
    ValueError
        If the oscillation is not larger than the hysteresis.
    """
    if not oscillation.amplitude > relay.hysteresis:
        raise ValueError(
            f"amplitude: {oscillation.amplitude} found, more than hysteresis {relay.hysteresis} "
            "allowed"
        )
    swing = math.sqrt(oscillation.amplitude**2 - relay.hysteresis**2)
    return UltimatePoint(4.0 * relay.amplitude / (math.pi * swing), oscillation.period_s)


Rule = Literal["ziegler-nichols", "tyreus-luyben"]

_RULES: dict[tuple[str, bool], tuple[float, float, float]] = {
    ("ziegler-nichols", False): (0.45, 1.0 / 1.2, 0.0),
    ("ziegler-nichols", True): (0.6, 0.5, 0.125),
    ("tyreus-luyben", False): (1.0 / 3.2, 2.2, 0.0),
    ("tyreus-luyben", True): (1.0 / 2.2, 2.2, 1.0 / 6.3),
}


def ultimate_gains(
    point: UltimatePoint, rule: Rule = "tyreus-luyben", derivative: bool = False
) -> PidGains:
    """Return PI gains, or PID gains with `derivative`, from the ultimate point.

    Sources: J. G. Ziegler and N. B. Nichols, Trans. ASME 64 (1942): fast, badly damped (the decay
    ratio is a quarter). B. D. Tyreus and W. L. Luyben, Ind. Eng. Chem. Res. 31 (1992), PID values
    as in W. L. Luyben and M. L. Luyben, *Essentials of Process Control* (1997): well damped.
    """
    kc, ti, td = _RULES[rule, derivative]
    gain = kc * point.gain
    return PidGains(gain, gain / (ti * point.period_s), gain * td * point.period_s)
