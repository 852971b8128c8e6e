from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import optimize

from robotctl.control.identification.identification import FirstOrderModel, fit_first_order
from robotctl.control.identification.step_metrics import step_metrics
from robotctl.control.identification.tuning import (
    Oscillation,
    Relay,
    UltimatePoint,
    measure_oscillation,
    simc_pi,
    ultimate_gains,
    ultimate_point,
)
from robotctl.control.pid import PidConfig
from robotctl.control.pwm import PwmConfig

WHEEL = FirstOrderModel(gain=2.2, time_constant_s=0.08, delay_s=0.02)
H = 0.001


class Process:
    """First order with dead time, exact at the sampling instants."""

    def __init__(self, model):
        self.decay = math.exp(-H / model.time_constant_s)
        self.gain = model.gain
        self.line = [0.0] * round(model.delay_s / H)
        self.y = 0.0

    def step(self, u):
        self.line.append(u)
        self.y = self.decay * self.y + (1.0 - self.decay) * self.gain * self.line.pop(0)
        return self.y


def pi_response(gains, model, seconds=1.5):
    process, integral, out = Process(model), 0.0, []
    for _ in range(round(seconds / H)):
        error = 1.0 - process.y
        integral += gains.ki * error * H
        out.append(process.step(gains.kp * error + integral))
    return step_metrics(np.arange(1, len(out) + 1) * H, out, 1.0)


def gain_margin(gains, model):
    """Gain of the loop where its phase is -180 deg, inverted."""

    def phase(w):
        controller = math.atan2(-gains.ki / w, gains.kp)
        return controller - math.atan(w * model.time_constant_s) - w * model.delay_s

    w = optimize.brentq(lambda w: phase(w) + math.pi, 1.0, math.pi / model.delay_s)
    process = model.gain / math.hypot(1.0, w * model.time_constant_s)
    return 1.0 / (process * math.hypot(gains.kp, gains.ki / w))


def test_simc_has_the_gain_margin_of_the_paper():
    gains = simc_pi(WHEEL)  # tau_c = theta, Ti = tau: gain margin pi
    assert gain_margin(gains, WHEEL) == pytest.approx(math.pi, rel=0.01)
    assert gains.ki == pytest.approx(gains.kp / 0.08)


def test_simc_shortens_the_integral_time_of_a_slow_process():
    slow = FirstOrderModel(1.0, 1.0, 0.02)
    gains = simc_pi(slow)
    assert gains.kp / gains.ki == pytest.approx(4.0 * 0.04)


def test_gains_from_a_measured_step_control_the_process_it_came_from():
    process, times = Process(WHEEL), np.arange(0.0, 1.0, H)
    response = [process.y]
    response += [process.step(1.5) for _ in times[1:]]
    model = fit_first_order(times, response, 1.5)
    assert model.gain == pytest.approx(2.2, rel=0.01)
    metrics = pi_response(simc_pi(model), WHEEL)
    assert metrics.overshoot < 0.08
    assert metrics.settling_s < 0.3
    assert metrics.steady_state_error == pytest.approx(0.0, abs=1e-4)


def relay_record(model, relay, setpoint=0.0, seconds=3.0):
    process = Process(model)
    out = [process.step(relay.step(setpoint, process.y)) for _ in range(round(seconds / H))]
    return np.arange(len(out)) * H, np.array(out)


@pytest.mark.parametrize("delay_s", [0.01, 0.02, 0.08])
def test_relay_oscillation_is_the_closed_form_one(delay_s):
    # First order with dead time under a relay, K. J. Astrom and T. Hagglund (2006), section 8.5.
    model = FirstOrderModel(2.2, 0.08, delay_s)
    relay = Relay(1.5)
    oscillation = measure_oscillation(*relay_record(model, relay))
    half_period = 0.08 * math.log(2.0 * math.exp(delay_s / 0.08) - 1.0)
    assert oscillation.period_s == pytest.approx(2.0 * half_period, abs=2.5 * H)
    amplitude = 2.2 * 1.5 * -math.expm1(-delay_s / 0.08)
    assert oscillation.amplitude == pytest.approx(amplitude, rel=0.12)
    assert oscillation.cycles >= 3


@pytest.mark.parametrize("delay_s", [0.01, 0.02, 0.08])
def test_ultimate_point_is_right_within_the_describing_function(delay_s):
    model = FirstOrderModel(2.2, 0.08, delay_s)
    w = optimize.brentq(
        lambda w: math.atan(w * 0.08) + w * delay_s - math.pi, 1.0, math.pi / delay_s
    )
    relay = Relay(1.5)
    point = ultimate_point(relay, measure_oscillation(*relay_record(model, relay)))
    assert point.gain == pytest.approx(math.hypot(1.0, 0.08 * w) / 2.2, rel=0.3)
    assert point.period_s == pytest.approx(2.0 * math.pi / w, rel=0.15)


def test_hysteresis_and_bias_are_allowed_for():
    oscillation = Oscillation(0.1, 0.5, 5)
    assert ultimate_point(Relay(1.0, 0.3), oscillation).gain == pytest.approx(4.0 / (math.pi * 0.4))
    with pytest.raises(ValueError, match="hysteresis"):
        ultimate_point(Relay(1.0, 0.5), oscillation)
    relay = Relay(1.0, 0.1, bias=2.0)
    assert [relay.step(0.0, y) for y in (-0.2, 0.05, 0.2, 0.0, -0.05, -0.2)] == [
        3.0,
        3.0,
        1.0,
        1.0,
        1.0,
        3.0,
    ]
    assert relay.step(0.0, math.nan) == 2.0


@pytest.mark.parametrize("rule", ["ziegler-nichols", "tyreus-luyben"])
def test_relay_gains_are_stable_and_tyreus_luyben_is_the_calmer_rule(rule):
    relay = Relay(1.5)
    point = ultimate_point(relay, measure_oscillation(*relay_record(WHEEL, relay)))
    gains = ultimate_gains(point, rule)
    metrics = pi_response(gains, WHEEL, 3.0)
    assert abs(metrics.steady_state_error) < 0.01
    margin = gain_margin(gains, WHEEL)
    assert margin > (3.0 if rule == "tyreus-luyben" else 1.8)


def test_the_tables_are_those_of_the_papers():
    point = UltimatePoint(8.0, 0.4)
    assert ultimate_gains(point, "ziegler-nichols") == pytest.approx((3.6, 3.6 * 1.2 / 0.4, 0.0))
    assert ultimate_gains(point, "ziegler-nichols", derivative=True) == pytest.approx(
        (4.8, 4.8 / 0.2, 4.8 * 0.05)
    )
    assert ultimate_gains(point) == pytest.approx((2.5, 2.5 / 0.88, 0.0))
    kp = 8.0 / 2.2
    assert ultimate_gains(point, derivative=True) == pytest.approx((kp, kp / 0.88, kp * 0.4 / 6.3))


def test_noise_at_the_middle_makes_no_cycles():
    rng = np.random.default_rng(10)
    t = np.arange(0.0, 2.0, H)
    y = 3.0 + np.sin(2.0 * math.pi * 5.0 * t) + rng.normal(0.0, 0.05, t.size)
    oscillation = measure_oscillation(t, y)
    assert oscillation.period_s == pytest.approx(0.2, rel=0.02)
    assert oscillation.amplitude == pytest.approx(1.1, abs=0.08)


@pytest.mark.parametrize(
    ("y", "message"),
    [
        (lambda t: np.sin(2.0 * math.pi * t), "cycles"),
        (lambda t: np.exp(t) * np.sin(20.0 * math.pi * t), "not steady"),
        (np.zeros_like, "cycles"),
    ],
)
def test_records_without_a_steady_oscillation_are_refused(y, message):
    t = np.arange(0.0, 2.0, H)
    with pytest.raises(ValueError, match=message):
        measure_oscillation(t, y(t))


def test_a_tuned_wheel_is_better_than_an_untuned_one(wheel_loop_rig):
    """The way of `robotctl tune`: measure a step of the voltage, fit, tune, compare."""
    pwm = PwmConfig(deadband=0.02, slew_per_s=math.inf)

    def closed_loop(config):
        rig = wheel_loop_rig(config, pwm)
        speeds = [rig.step(6.0) for _ in range(600)]
        return step_metrics(np.arange(1, 601) * 0.005, speeds, 6.0)

    # Open loop: the feed-forward term alone, between two speeds.
    rig = wheel_loop_rig(PidConfig(kv=1.0), pwm)
    record = []
    for k in range(400):
        record.append(rig.estimator.velocity_rad_s)
        rig.step(3.0 if k < 200 else 6.0)
    times = (np.arange(400) - 200) * 0.005
    model = fit_first_order(times[100:], record[100:], 3.0)
    assert model.gain == pytest.approx(1.0 / 0.45, rel=0.02)
    assert model.time_constant_s == pytest.approx(0.08, rel=0.2)
    assert 0.005 < model.delay_s < 0.03
    untuned = closed_loop(PidConfig(kp=0.1, ki=0.5))
    tuned = closed_loop(PidConfig(**simc_pi(model, 0.06)._asdict()))
    assert tuned.overshoot < 0.1
    assert tuned.settling_s is not None
    assert tuned.settling_s < 0.5
    assert untuned.settling_s is None or untuned.settling_s > 2.0 * tuned.settling_s


@pytest.mark.parametrize(
    "model",
    [
        FirstOrderModel(-1.0, 0.1, 0.01),
        FirstOrderModel(1.0, 0.0, 0.01),
        FirstOrderModel(1.0, 0.1, -0.01),
        FirstOrderModel(math.nan, 0.1, 0.01),
    ],
)
def test_processes_the_rules_do_not_fit_are_refused(model):
    with pytest.raises(ValueError, match=r"^model: "):
        simc_pi(model)


def test_a_closed_loop_without_any_time_is_refused():
    with pytest.raises(ValueError, match=r"^closed_loop_s: "):
        simc_pi(FirstOrderModel(1.0, 0.1, 0.0))
    with pytest.raises(ValueError, match=r"^closed_loop_s: "):
        simc_pi(WHEEL, -1.0)


@pytest.mark.parametrize(
    ("arguments", "name"), [((0.0,), "amplitude"), ((1.0, -0.1), "hysteresis")]
)
def test_a_relay_without_height_is_refused(arguments, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        Relay(*arguments)
