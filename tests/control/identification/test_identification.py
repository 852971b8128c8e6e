from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.identification.identification import (
    effective_voltage_v,
    fit_feedforward,
    fit_first_order,
    local_slope,
)
from robotctl.control.pwm import PwmConfig, PwmMap

H = 0.005


def first_order(t, gain, tau, theta, height, y0=0.0):
    return y0 + gain * height * -np.expm1(-np.maximum(t - theta, 0.0) / tau)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.2, 20.0),
    st.floats(0.03, 0.3),
    st.floats(0.0, 0.1),
    st.floats(-5.0, 5.0),
    st.sampled_from([-3.0, 0.5, 4.0]),
)
def test_a_clean_response_gives_back_its_model(gain, tau, theta, y0, height):
    t = np.arange(-0.2, 2.0, H)
    model = fit_first_order(t, first_order(t, gain, tau, theta, height, y0), height)
    assert model.gain == pytest.approx(gain, rel=1e-3)
    assert model.time_constant_s == pytest.approx(tau, rel=0.01)
    assert model.delay_s == pytest.approx(theta, abs=0.001)
    assert model.rms_error < 1e-3 * abs(gain * height)


def test_a_noisy_response_gives_nearly_its_model():
    rng = np.random.default_rng(4)
    t = np.arange(-0.2, 1.5, H)
    y = first_order(t - 0.1, 2.2, 0.08, 0.02, 3.0, 5.0) + rng.normal(0.0, 0.15, t.size)
    model = fit_first_order(t, y, 3.0, step_time_s=0.1)
    assert model.gain == pytest.approx(2.2, rel=0.02)
    assert model.time_constant_s == pytest.approx(0.08, rel=0.1)
    assert model.delay_s == pytest.approx(0.02, abs=0.005)
    assert model.rms_error == pytest.approx(0.15, rel=0.15)


def test_the_motor_between_two_speeds_is_a_first_order_process(motor_rig):
    motor, speeds, times = motor_rig(tau_s=0.08, deadband=0.0), [], []
    for k in range(500):
        speeds.append(motor.omega_rad_s)
        times.append((k - 250) * H)
        motor.step(0.3 if k < 250 else 0.6, 12.0, H)
    model = fit_first_order(times[150:], speeds[150:], 0.3 * 12.0)
    assert model.gain == pytest.approx(1.0 / 0.45, rel=0.01)
    assert model.time_constant_s == pytest.approx(0.08, rel=0.02)
    assert model.delay_s == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"input_step": 0.0}, "input_step"),
        ({"input_step": math.nan}, "input_step"),
        ({"response": np.ones(100)}, "does not move"),
        ({"response": np.full(100, math.nan)}, "not finite"),
        ({"response": np.ones(99)}, "shapes"),
        ({"time_s": np.arange(100, 0, -1.0)}, "not increasing"),
        ({"step_time_s": 0.47}, "at least 8"),
    ],
)
def test_records_that_cannot_be_fitted_are_refused(change, message):
    t = np.arange(100) * H
    good = {"time_s": t, "response": first_order(t, 1.0, 0.1, 0.0, 1.0), "input_step": 1.0}
    with pytest.raises(ValueError, match=message):
        fit_first_order(**(good | change))


def test_effective_voltage_is_the_inverse_of_the_pwm_mapping():
    pwm = PwmMap(PwmConfig(deadband=0.05, slew_per_s=math.inf))
    wanted = np.linspace(-11.0, 11.0, 23)
    duties = [pwm.step(v, 12.0, H) for v in wanted]
    np.testing.assert_allclose(effective_voltage_v(duties, 12.0, 0.05), wanted, atol=1e-9)
    assert effective_voltage_v(0.04, 12.0, 0.05) == 0.0


def drive_record(motor_rig, rng, seconds=8.0):
    """Duties that hop between speeds of both directions, and the encoder's answer."""
    motor = motor_rig(tau_s=0.08)
    duties, angles, duty = [], [], 0.0
    for k in range(round(seconds / H)):
        if k % 60 == 0:
            duty = rng.uniform(0.15, 0.7) * rng.choice([-1.0, 1.0])
        duties.append(duty)
        angles.append(motor.angle_rad)
        motor.step(duty, 12.0, H)
    counts = np.floor(np.array(angles) / (2.0 * math.pi) * 2400)
    return np.array(duties), counts * 2.0 * math.pi / 2400


def test_feedforward_gains_of_the_motor_come_out_of_a_quantised_record(motor_rig):
    duties, angles = drive_record(motor_rig, np.random.default_rng(6))
    omega = local_slope(angles, H, 2)
    alpha = local_slope(omega, H, 2)
    # Duty k acts from sample k to k + 1; the slopes are centred on sample k.
    duties = 0.5 * (duties + np.roll(duties, 1))
    voltage = effective_voltage_v(duties, 12.0, 0.02)
    fit = fit_feedforward(voltage, omega, alpha)
    assert fit.kv == pytest.approx(0.45, rel=0.03)
    assert fit.ks == pytest.approx(0.3, abs=0.06)
    assert fit.ka == pytest.approx(0.45 * 0.08, rel=0.15)


def test_an_exact_record_gives_exact_gains_whatever_the_standstill_holds():
    rng = np.random.default_rng(7)
    omega = rng.uniform(-10.0, 10.0, 200)
    alpha = rng.uniform(-50.0, 50.0, 200)
    voltage = 0.4 * omega + 0.25 * np.sign(omega) + 0.03 * alpha
    voltage[np.abs(omega) < 0.5] = 99.0
    alpha[3] = math.nan
    fit = fit_feedforward(voltage, omega, alpha)
    assert (fit.kv, fit.ks, fit.ka) == pytest.approx((0.4, 0.25, 0.03))
    assert fit.rms_error_v == pytest.approx(0.0, abs=1e-12)
    assert fit.samples == np.count_nonzero(np.abs(np.delete(omega, 3)) > 0.5)


def test_a_gain_that_would_be_negative_is_zero_and_the_others_are_fitted_without_it():
    rng = np.random.default_rng(8)
    omega, alpha = rng.uniform(-10.0, 10.0, 300), rng.uniform(-50.0, 50.0, 300)
    voltage = 0.4 * omega - 0.05 * np.sign(omega) + 0.03 * alpha
    fit = fit_feedforward(voltage, omega, alpha)
    assert fit.ks == 0.0
    assert fit.kv == pytest.approx(0.392, abs=0.005)
    assert fit.ka == pytest.approx(0.03, rel=0.02)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ((np.ones(5), np.ones(5), np.ones(5)), "at least 10"),
        ((np.ones(50), np.ones(50), np.zeros(50)), "told apart"),
        ((np.ones(50), np.full(50, 5.0), np.linspace(-1, 1, 50)), "told apart"),
        ((np.ones(50), np.ones(49), np.ones(50)), "shapes"),
    ],
)
def test_records_that_cannot_tell_the_gains_are_refused(record, message):
    with pytest.raises(ValueError, match=message):
        fit_feedforward(*record)


def test_a_reversed_encoder_is_named():
    rng = np.random.default_rng(9)
    omega, alpha = rng.uniform(-10.0, 10.0, 300), rng.uniform(-50.0, 50.0, 300)
    with pytest.raises(ValueError, match="reversed"):
        fit_feedforward(-0.4 * omega, omega, alpha)


def test_local_slope_of_a_parabola_is_exact_and_without_delay():
    t = np.arange(50) * 0.1
    slope = local_slope(3.0 * t**2 - t, 0.1, 3)
    np.testing.assert_allclose(slope[3:-3], 6.0 * t[3:-3] - 1.0, rtol=1e-9)
    assert np.all(np.isnan(slope[:3]))
    assert np.all(np.isnan(slope[-3:]))
    with pytest.raises(ValueError, match="half_window"):
        local_slope(t, 0.1, 0)
    with pytest.raises(ValueError, match="values"):
        local_slope(t[:5], 0.1, 3)
