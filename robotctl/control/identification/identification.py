"""Models of a wheel from records: its step response, and the voltage for its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_GRID: Final = 12
_ROUNDS: Final = 14


@dataclass(frozen=True, slots=True)
class FirstOrderModel:
    """First order plus dead time: K exp(-theta s) / (tau s + 1).

    Parameters
    ----------
    gain
        K [output / input; rad/s per V for a wheel].
    time_constant_s
        tau [s], > 0.
    delay_s
        theta, all dead time of the recorded loop [s], >= 0.
    rms_error
        Residual of the fit [output unit]; 0 for a model without a fit.
    """

    gain: float
    time_constant_s: float
    delay_s: float
    rms_error: float = 0.0


def fit_first_order(
    time_s: ArrayLike,
    response: ArrayLike,
    input_step: float,
    step_time_s: float = 0.0,
) -> FirstOrderModel:
    """Fit a first-order model with dead time to a measured step response.

    Least squares over gain, initial value (both linear, solved exactly for each trial), time
    constant and delay (searched on a grid that closes in on the best), so the answer is global and
    deterministic. The input must be constant but for the step, and the output at rest before it.
    With Coulomb friction the wheel must turn in one direction throughout: step between two speeds,
    not from standstill.

    Source: variable projection, G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973).

    Parameters
    ----------
    time_s, response
        The record, shape (n,) each, times increasing [s]. It should last several time constants.
    input_step
        Height of the input's step, not 0 [V].
    step_time_s
        Time of the input's step [s].

    Raises
    ------
    ValueError
        If the record is malformed, has fewer than 8 samples after the step, or does not move.
    """
    t, y = np.asarray(time_s, dtype=np.float64), np.asarray(response, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape:
        raise ValueError(f"record: shapes {t.shape} and {y.shape} found, (n,) for both allowed")
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(y)) and np.all(np.diff(t) > 0.0)):
        raise ValueError("record: a value is not finite, or time_s is not increasing")
    if input_step == 0.0 or not math.isfinite(input_step):
        raise ValueError(f"input_step: {input_step} found, a finite number other than 0 allowed")
    t = t - step_time_s
    after = t[t >= 0.0]
    if after.size < 8:
        raise ValueError(f"record: {after.size} samples after the step found, at least 8 needed")
    if np.ptp(y) == 0.0:
        raise ValueError("record: the response does not move")
    span = float(after[-1])
    tau_low, tau_high = span / 1000.0, span
    theta_low, theta_high = 0.0, 0.5 * span
    for _ in range(_ROUNDS):
        taus = np.geomspace(tau_low, tau_high, _GRID)
        thetas = np.linspace(theta_low, theta_high, _GRID)
        tau, theta, height, squares = _best(t, y, taus, thetas)
        # Two cells to either side: the valley of the squares runs diagonally through the grid.
        ratio = (tau_high / tau_low) ** (2.0 / (_GRID - 1))
        reach = 2.0 * (theta_high - theta_low) / (_GRID - 1)
        tau_low, tau_high = max(tau / ratio, span / 1000.0), min(tau * ratio, 4.0 * span)
        theta_low, theta_high = max(0.0, theta - reach), min(theta + reach, 0.9 * span)
    return FirstOrderModel(height / input_step, tau, theta, math.sqrt(squares / t.size))


def _best(
    t: NDArray[np.float64],
    y: NDArray[np.float64],
    taus: NDArray[np.float64],
    thetas: NDArray[np.float64],
) -> tuple[float, float, float, float]:
    """Return tau, theta, height and sum of squares of the best point of a grid."""
    tau = np.repeat(taus, thetas.size)[:, None]
    theta = np.tile(thetas, taus.size)[:, None]
    shape = -np.expm1(-np.maximum(t - theta, 0.0) / tau)
    # Linear regression y = y0 + height * shape, one per row.
    shape_centred = shape - shape.mean(axis=1, keepdims=True)
    y_centred = y - y.mean()
    power = np.maximum(np.sum(shape_centred**2, axis=1), 1e-300)
    height = shape_centred @ y_centred / power
    squares = np.sum((y_centred - height[:, None] * shape_centred) ** 2, axis=1)
    i = int(np.argmin(squares))
    return float(tau[i, 0]), float(theta[i, 0]), float(height[i]), float(squares[i])


@dataclass(frozen=True, slots=True)
class FeedforwardFit:
    """Feed-forward gains in the units of `PidConfig`, and the quality of their fit.

    Parameters
    ----------
    kv, ks, ka
        V s/rad, V, V s^2/rad.
    rms_error_v
        Residual [V].
    samples
        Number of samples used.
    """

    kv: float
    ks: float
    ka: float
    rms_error_v: float
    samples: int


def effective_voltage_v(
    duty: ArrayLike, bus_voltage_v: ArrayLike, deadband: float
) -> NDArray[np.float64]:
    """Return the mean motor voltage [V] of recorded duties, for the bridge of `pwm.py`.

    Parameters
    ----------
    duty, bus_voltage_v
        The record, shapes that broadcast [-1, 1], [V].
    deadband
        Dead-band of the bridge, [0, 1).
    """
    d = np.asarray(duty, dtype=np.float64)
    bus = np.asarray(bus_voltage_v, dtype=np.float64)
    effective = np.sign(d) * np.maximum(0.0, np.abs(d) - deadband) / (1.0 - deadband) * bus
    return np.asarray(effective, dtype=np.float64)


def local_slope(values: ArrayLike, dt_s: float, half_window: int) -> NDArray[np.float64]:
    """Return the derivative of an evenly sampled record by a straight line through a window.

    Source: A. Savitzky and M. J. E. Golay, Analytical Chemistry 36 (1964), first order. Unlike a
    difference it has no delay, and its noise falls with the window's length to the power 3/2.

    Parameters
    ----------
    values
        Shape (n,).
    dt_s
        Sampling period [s], > 0.
    half_window
        Samples to either side, >= 1. The first and last `half_window` results are nan.

    Raises
    ------
    ValueError
        If a parameter is out of range or the record is shorter than a window.
    """
    y = np.asarray(values, dtype=np.float64)
    width = 2 * half_window + 1
    if half_window < 1 or not 0.0 < dt_s < math.inf:
        raise ValueError(f"half_window {half_window}, dt_s {dt_s}: >= 1 and > 0 allowed")
    if y.ndim != 1 or y.size < width:
        raise ValueError(f"values: shape {y.shape} found, at least ({width},) needed")
    weights = np.arange(-half_window, half_window + 1, dtype=np.float64)
    slope = np.full(y.shape, np.nan)
    slope[half_window : y.size - half_window] = np.correlate(y, weights, "valid") / (
        dt_s * np.sum(weights**2)
    )
    return slope


def _gains(
    columns: NDArray[np.float64], scale: NDArray[np.float64], u: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return kv, ks and ka of least squares, with ks and ka >= 0."""
    gains = np.zeros(3)
    free = [0, 1, 2]
    while True:
        gains[free] = np.linalg.lstsq(columns[:, free], u, rcond=None)[0]
        # A negative friction or inertia is noise; kv may not be removed, so its sign is checked.
        worst = int(np.argmin(gains * scale))
        if worst == 0 or gains[worst] >= 0.0:
            return gains
        free.remove(worst)
        gains[worst] = 0.0


def fit_feedforward(
    voltage_v: ArrayLike,
    omega_rad_s: ArrayLike,
    alpha_rad_s2: ArrayLike,
    omega_min_rad_s: float = 0.5,
) -> FeedforwardFit:
    """Fit u = kv w + ks sign(w) + ka a to a record by least squares.

    The record should contain several steady speeds (they separate kv from ks) and hard
    accelerations.
    Samples slower than `omega_min_rad_s`, where friction is not Coulomb's, and samples with a value
    that is not finite are left out. A ks or ka that comes out negative is set to 0 and the rest
    fitted again. Noise in `alpha_rad_s2` makes ka too small: use `local_slope` with a window
    well below the motor's time constant, and give speed and acceleration the same filter.

    Source: the quasi-static DC motor, and the regression of WPILib's SysId documentation
    ("feedforward analysis"); L. Ljung, *System Identification*, 2nd ed., section 7.3.

    Parameters
    ----------
    voltage_v
        Mean motor voltage, shape (n,) [V]; see `effective_voltage_v`.
    omega_rad_s, alpha_rad_s2
        Speed and acceleration of the wheel, shape (n,) [rad/s, rad/s^2].
    omega_min_rad_s
        Minimum speed used [rad/s], >= 0.

    Raises
    ------
    ValueError
        If the shapes differ, fewer than 10 samples are left, the record cannot separate the gains,
        or kv is not positive.
    """
    u, w, a = (np.asarray(x, dtype=np.float64) for x in (voltage_v, omega_rad_s, alpha_rad_s2))
    if not (u.ndim == 1 and u.shape == w.shape == a.shape):
        raise ValueError(f"record: shapes {u.shape}, {w.shape}, {a.shape} found, (n,) allowed")
    used = np.isfinite(u + w + a) & (np.abs(w) > omega_min_rad_s)
    u, w, a = u[used], w[used], a[used]
    if u.size < 10:
        raise ValueError(f"record: {u.size} usable samples found, at least 10 needed")
    columns = np.column_stack([w, np.sign(w), a])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    # Columns of unit size: otherwise the condition number would depend on the units.
    if np.any(scale == 0.0) or np.linalg.cond(columns / scale) > 100.0:
        raise ValueError(
            "record: kv, ks and ka cannot be told apart; drive at several speeds and accelerate"
        )
    gains = _gains(columns, scale, u)
    if not gains[0] > 0.0:
        raise ValueError(f"kv: {gains[0]:.4g} fitted; is the encoder or the motor reversed?")
    residual = u - columns @ gains
    kv, ks, ka = (float(gain) for gain in gains)
    return FeedforwardFit(kv, ks, ka, float(np.sqrt(np.mean(residual**2))), int(u.size))
