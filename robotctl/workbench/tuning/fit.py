"""Models, feed-forward and gains of each wheel, from the records of the experiments."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.control.identification.identification import (
    FeedforwardFit,
    FirstOrderModel,
    effective_voltage_v,
    fit_feedforward,
    fit_first_order,
    local_slope,
)
from robotctl.control.identification.tuning import (
    Oscillation,
    PidGains,
    Relay,
    UltimatePoint,
    measure_oscillation,
    simc_pi,
    ultimate_gains,
    ultimate_point,
)
from robotctl.workbench.tuning.open_loop import OpenLoopRecord, RelayRun
from robotctl.workbench.tuning.track import Array

ESTIMATOR_DELAY_S: Final = 0.03
"""Longest delay of the wheel-velocity estimator: half of its window [s]."""

LOOP_PERIODS: Final = 1.5
"""Dead time of sampling and bus in control periods: one to act, half a one as mean age."""

_CLOSED_LOOP_SHARE: Final = 0.5
_INTEGRAL_DELAYS: Final = 4.0
_HALF_WINDOW_S: Final = 0.04
_BRAKING_SHARE: Final = 0.05
_RELAY_HALF_WINDOW_S: Final = 0.015
_SKIP_CYCLES: Final = 3


@dataclass(frozen=True, slots=True)
class WheelFit:
    """Result of the experiments for one wheel.

    Parameters
    ----------
    feedforward
        Gains against back-EMF, friction and inertia.
    model
        First-order model from volts to rad/s, with the dead time that the experiment showed.
    gains
        Feedback gains made from it.
    ultimate
        Ultimate point; None if no relay was used.
    """

    feedforward: FeedforwardFit
    model: FirstOrderModel
    gains: PidGains
    ultimate: UltimatePoint | None = None


def wheel_feedforward(record: OpenLoopRecord, wheel: int, deadband: float) -> FeedforwardFit:
    """Return kv, ks and ka of a wheel.

    Speed and acceleration come from the angle by straight lines through a short window, twice. The
    slope of such a line is a weighted mean of the true speed in the window; voltage and speed are
    weighted likewise, so that all three passed one filter and none of the gains is biased by it.

    Braking phases are left out: there gearbox losses help instead of hinder, and one ka cannot fit
    both.

    Raises
    ------
    ValueError
        If the record does not determine the gains.
    """
    dt_s = period_s(record)
    n = max(1, round(_HALF_WINDOW_S / dt_s))
    voltage = effective_voltage_v(record.duty, record.bus_voltage_v, deadband)
    slope = local_slope(record.position_rad[:, wheel], dt_s, n)
    speed = _weighted(_between(slope), n)
    acceleration = local_slope(slope, dt_s, n)
    forwards = acceleration * np.sign(speed)
    acceleration[forwards < -_BRAKING_SHARE * np.nanmax(np.abs(forwards))] = np.nan
    return fit_feedforward(_weighted(_between(_weighted(voltage, n)), n), speed, acceleration)


def period_s(record: OpenLoopRecord) -> float:
    """Return the control period of a record [s]."""
    return float(np.median(np.diff(record.time_s)))


def _weighted(values: Array, half_window: int) -> Array:
    """Weight intervals as `local_slope` weights the speed: value k holds from tick k to the next.

    Result k belongs to tick k; nan if the window leaves the record.
    """
    steps = np.arange(half_window, -half_window, -1, dtype=np.float64)
    weights = np.cumsum(steps)
    result: Array = np.full(values.shape, np.nan)
    result[half_window : values.size - half_window + 1] = np.correlate(
        values, weights / weights.sum(), "valid"
    )
    return result


def _between(values: Array) -> Array:
    """Return the means of neighbours: the value between tick k and the next; nan at the end."""
    following: Array = np.append(values[1:], np.nan)
    return 0.5 * (values + following)


def step_model(record: OpenLoopRecord, wheel: int, deadband: float) -> FirstOrderModel:
    """Return the model of a wheel: the median over all steps between two speeds of one direction.

    Raises
    ------
    ValueError
        If the record holds no such step.
    """
    voltage = effective_voltage_v(record.duty, record.bus_voltage_v, deadband)
    models = [
        _one_step(record, voltage, wheel, *step)
        for step in itertools.pairwise(_holds(record.duty))
        if _steps_within_one_direction(record.duty, *step)
    ]
    if not models:
        raise ValueError("record: no step between two duties of one direction")
    columns = zip(*map(dataclasses.astuple, models), strict=True)
    return FirstOrderModel(*(float(np.median(column)) for column in columns))


def _holds(duty: Array) -> list[tuple[int, int]]:
    """Return begin and end of each stretch of constant duty that is long enough for a fit."""
    edges = [0, *(int(k) + 1 for k in np.flatnonzero(np.diff(duty))), duty.size]
    return [(begin, end) for begin, end in itertools.pairwise(edges) if end - begin > 16]


def _steps_within_one_direction(
    duty: Array, before: tuple[int, int], after: tuple[int, int]
) -> bool:
    adjacent = before[1] == after[0]
    return adjacent and bool(duty[before[0]] * duty[after[0]] > 0.0)


def _one_step(
    record: OpenLoopRecord,
    voltage: Array,
    wheel: int,
    before: tuple[int, int],
    after: tuple[int, int],
) -> FirstOrderModel:
    """Fit one step, from the settled half of the stretch before it."""
    settled = slice((before[0] + before[1]) // 2, before[1])
    settled_after = slice((after[0] + after[1]) // 2, after[1])
    used = slice(settled.start, after[1])
    return fit_first_order(
        record.time_s[used],
        record.velocity_rad_s[used, wheel],
        float(voltage[settled_after].mean() - voltage[settled].mean()),
        float(record.time_s[after[0]]),
    )


def longest_delay_s(dt_s: float) -> float:
    """Return the loop's longest dead time [s]: at steady speed the estimator looks back farthest.

    A step of the open loop shows less, since the estimator shortens its window when the speed
    changes. Gains must bear both.
    """
    return ESTIMATOR_DELAY_S + LOOP_PERIODS * dt_s


def step_gains(model: FirstOrderModel, dt_s: float) -> PidGains:
    """Return SIMC gains for the longest dead time theta, with two changes.

    tau_c is theta / 2 instead of theta: tighter, with a maximum sensitivity of 1.8 at the longest
    dead time (2.2 for a very slow wheel) and 1.2 at one of 10 ms. And the integral time is at least
    4 theta: the set-point is brought by the feed-forward, and a faster integral winds up on what
    the feed-forward misses while accelerating, to overshoot by it afterwards.
    """
    delay_s = max(model.delay_s, longest_delay_s(dt_s))
    gains = simc_pi(dataclasses.replace(model, delay_s=delay_s), _CLOSED_LOOP_SHARE * delay_s)
    return gains._replace(ki=min(gains.ki, gains.kp / (_INTEGRAL_DELAYS * delay_s)))


def relay_fit(
    record: OpenLoopRecord, run: RelayRun, wheel: int, feedforward: FeedforwardFit
) -> WheelFit:
    """Return gains of a wheel by the rule of Tyreus and Luyben from a relay experiment.

    The relay's hysteresis counts as dead time, so the gains are those of a somewhat later loop.

    Raises
    ------
    ValueError
        If the oscillation is not steady or not that of a first-order process.
    """
    dt_s = period_s(record)
    n = max(1, round(_RELAY_HALF_WINDOW_S / dt_s))
    speed = local_slope(record.position_rad[:, wheel], dt_s, n)
    used = slice(run.begin, record.time_s.size - n)
    oscillation = measure_oscillation(record.time_s[used], speed[used], _SKIP_CYCLES)
    point = ultimate_point(run.relay, oscillation)
    model = relay_model(1.0 / feedforward.kv, run.relay, oscillation)
    return WheelFit(feedforward, model, ultimate_gains(point), point)


def relay_model(gain: float, relay: Relay, oscillation: Oscillation) -> FirstOrderModel:
    """Return the first-order model that swings as measured, its gain K known.

    With relay amplitude d, hysteresis epsilon, swing a and period T the speed runs along pieces of
    exponentials towards +-K d, turning theta after it has passed epsilon::

        tau = T / (2 ln((K d + a) / (K d - a)))        theta = tau ln((K d - epsilon) / (K d - a))

    Source: exact limit cycle, as in Q.-G. Wang, C.-C. Hang and B. Zou, "Low-order modeling from
    relay feedback", Ind. Eng. Chem. Res. 36 (1997).

    Raises
    ------
    ValueError
        If the swing is not between hysteresis and K d.
    """
    end, swing = gain * relay.amplitude, oscillation.amplitude
    if not relay.hysteresis <= swing < end:
        raise ValueError(
            f"amplitude: {swing:.3g} rad/s found, [{relay.hysteresis:.3g}, {end:.3g}) allowed"
        )
    tau_s = oscillation.period_s / (2.0 * math.log((end + swing) / (end - swing)))
    return FirstOrderModel(gain, tau_s, tau_s * math.log((end - relay.hysteresis) / (end - swing)))
