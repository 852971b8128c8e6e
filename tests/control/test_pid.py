from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from robotctl.control.pid import FRICTION_BAND_RAD_S, Pid, PidConfig, feedforward_v

H = 0.005
NO_LIMIT = math.inf
gains = st.floats(0.0, 50.0)
configs = st.builds(
    PidConfig,
    kp=gains,
    ki=gains,
    kd=st.floats(0.0, 1.0),
    derivative_filter_s=st.floats(0.0, 0.1),
    tracking_s=st.floats(0.0, 1.0),
)
speeds = st.floats(-100.0, 100.0)


def textbook(config, setpoints, measurements, limit, tracking_s):
    """Astrom and Murray's algorithm, written down again with arrays and no shortcuts."""
    integral, slope, last = 0.0, 0.0, measurements[0]
    outputs = []
    for r, y in zip(setpoints, measurements, strict=True):
        slope = (config.derivative_filter_s * slope + (y - last)) / (config.derivative_filter_s + H)
        v = config.kp * (r - y) + integral - config.kd * slope
        u = float(np.clip(v, -limit, limit))
        integral += H * config.ki * (r - y) + H / tracking_s * (u - v)
        last = y
        outputs.append(u)
    return np.array(outputs)


def test_follows_the_textbook_algorithm_in_and_out_of_saturation():
    rng = np.random.default_rng(1)
    config = PidConfig(kp=2.0, ki=15.0, kd=0.02, derivative_filter_s=0.01, tracking_s=0.05)
    setpoints = np.repeat(rng.uniform(-5.0, 5.0, 20), 20)
    measurements = np.cumsum(rng.normal(0.0, 0.2, 400))
    pid = Pid(config)
    pid.reset(measurements[0])
    ours = [pid.step(r, y, H, 0.0, 6.0) for r, y in zip(setpoints, measurements, strict=True)]
    expected = textbook(config, setpoints, measurements, 6.0, 0.05)
    assert np.count_nonzero(np.abs(expected) == 6.0) > 20
    assert np.count_nonzero(np.abs(expected) < 6.0) > 20
    np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-12)


def test_without_limits_it_is_the_transfer_function_of_its_terms():
    kp, ki, kd, tf = 2.0, 10.0, 0.1, 0.02
    error = np.random.default_rng(2).normal(0.0, 1.0, 300)
    error[0] = 0.0
    pid = Pid(PidConfig(kp=kp, ki=ki, kd=kd, derivative_filter_s=tf))
    ours = [pid.step(0.0, -e, H, 0.0, NO_LIMIT) for e in error]
    integral = signal.lfilter([0.0, ki * H], [1.0, -1.0], error)
    derivative = signal.lfilter([kd, -kd], [tf + H, -tf], error)
    np.testing.assert_allclose(ours, kp * error + integral + derivative, rtol=1e-9, atol=1e-9)


def test_filtered_derivative_has_the_step_response_of_a_first_order_lag():
    tf = 0.05
    pid = Pid(PidConfig(kd=1.0, derivative_filter_s=tf))
    fine = tf / 200.0
    ramp = [pid.step(0.0, 3.0 * k * fine, fine, 0.0, NO_LIMIT) for k in range(1, 1001)]
    times = np.arange(1, 1001) * fine
    np.testing.assert_allclose(ramp, -3.0 * (1.0 - np.exp(-times / tf)), atol=0.01)


def test_setpoint_step_gives_no_derivative_kick():
    pid = Pid(PidConfig(kp=1.0, kd=10.0))
    pid.step(0.0, 1.0, H, 0.0, NO_LIMIT)
    assert pid.step(1.0, 1.0, H, 0.0, NO_LIMIT) - pid.step(0.0, 1.0, H, 0.0, NO_LIMIT) == 1.0


def first_order_loop(pid, setpoints, limit, gain=2.0, tau_s=0.1):
    y, outputs = 0.0, []
    decay = math.exp(-H / tau_s)
    for r in setpoints:
        y = decay * y + (1.0 - decay) * gain * pid.step(r, y, H, 0.0, limit)
        outputs.append(y)
    return np.array(outputs)


def test_back_calculation_leaves_saturation_without_windup():
    setpoints = np.concatenate([np.full(400, 10.0), np.full(400, 1.0)])
    wound = first_order_loop(Pid(PidConfig(kp=0.5, ki=5.0, tracking_s=1e9)), setpoints, 2.0)
    tracked = first_order_loop(Pid(PidConfig(kp=0.5, ki=5.0)), setpoints, 2.0)
    late_wound = np.flatnonzero(np.abs(wound[400:] - 1.0) > 0.1)[-1] * H
    late_tracked = np.flatnonzero(np.abs(tracked[400:] - 1.0) > 0.1)[-1] * H
    assert late_tracked < 0.4
    assert late_wound > 4.0 * late_tracked
    assert abs(tracked[-1] - 1.0) < 1e-3


def test_integral_of_a_saturated_output_converges_to_the_back_calculated_value():
    # At rest of the integral: ki e + (u - w) / T_t = 0 with w = kp e + I.
    config = PidConfig(kp=1.0, ki=4.0, tracking_s=0.1)
    pid = Pid(config)
    for _ in range(1000):
        pid.step(10.0, 0.0, H, 0.0, 5.0)
    assert pid.integral == pytest.approx(5.0 + 4.0 * 10.0 * 0.1 - 10.0)


def test_integral_removes_the_steady_state_error():
    response = first_order_loop(Pid(PidConfig(kp=0.5, ki=5.0)), [1.0] * 600, 10.0)
    assert response[-1] == pytest.approx(1.0, abs=1e-6)
    only_p = first_order_loop(Pid(PidConfig(kp=0.5)), [1.0] * 600, 10.0)
    assert only_p[-1] == pytest.approx(0.5 * 2.0 / (1.0 + 0.5 * 2.0))


@settings(deadline=None)
@given(configs, st.lists(st.tuples(speeds, speeds), min_size=1, max_size=30), st.floats(0.0, 24.0))
def test_output_is_within_the_limit_whatever_comes(config, inputs, limit):
    pid = Pid(config)
    assert all(abs(pid.step(r, y, H, 0.0, limit)) <= limit for r, y in inputs)


@settings(deadline=None)
@given(configs, configs, st.lists(st.tuples(speeds, speeds), min_size=1, max_size=20))
def test_output_is_continuous_across_a_gain_change(before, after, inputs):
    pid = Pid(before)
    pid.reset(inputs[0][1])
    for r, y in inputs:
        pid.step(r, y, H, 1.5, 12.0)
    # A twin that goes on with the old gains says what the output would have been.
    r, y = inputs[-1]
    twin_slope = pid._slope
    old = 1.5 + before.kp * (r - y) + pid.integral - before.kd * twin_slope
    pid.set_gains(after, 2.0)
    new = 2.0 + after.kp * (r - y) + pid.integral - after.kd * twin_slope
    assert new == pytest.approx(old, rel=1e-9, abs=1e-6)
    assert pid.config == after


def test_gain_change_in_steady_state_is_not_seen_at_the_output():
    pid = Pid(PidConfig(kp=0.5, ki=5.0, kv=0.2))
    y, outputs = 0.0, []
    for k in range(800):
        if k == 600:
            pid.set_gains(PidConfig(kp=2.0, ki=8.0, kv=0.4), feedforward=0.4 * 3.0)
        u = pid.step(3.0, y, H, pid.config.kv * 3.0, 12.0)
        y += H / 0.1 * (2.0 * u - y)
        outputs.append(u)
    np.testing.assert_allclose(outputs[590:], 1.5, atol=1e-6)


def test_what_a_gain_change_leaves_without_integral_gain_fades_away():
    pid = Pid(PidConfig(kp=1.0, ki=2.0))
    for _ in range(100):
        pid.step(1.0, 0.0, H, 0.0, 10.0)
    pid.set_gains(PidConfig(kp=1.0, tracking_s=0.1))
    first = pid.step(1.0, 0.0, H, 0.0, 10.0)
    for _ in range(400):
        last = pid.step(1.0, 0.0, H, 0.0, 10.0)
    assert first == pytest.approx(2.0, abs=0.02)
    assert last == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("argument", ["setpoint", "measurement", "feedforward", "dt_s", "limit"])
def test_bad_input_gives_zero_and_holds_the_state(argument, bad):
    if argument == "limit" and bad == math.inf:
        return  # an infinite limit is none at all
    pid, twin = Pid(PidConfig(kp=1.0, ki=2.0)), Pid(PidConfig(kp=1.0, ki=2.0))
    good = {"setpoint": 2.0, "measurement": 1.0, "dt_s": H, "feedforward": 0.5, "limit": 12.0}
    for _ in range(10):
        pid.step(**good)
        twin.step(**good)
    assert pid.step(**(good | {argument: bad})) == 0.0
    assert pid.integral == twin.integral
    assert pid.step(**good) == twin.step(**good)


@pytest.mark.parametrize(("dt_s", "limit"), [(0.0, 12.0), (-H, 12.0), (H, -1.0)])
def test_time_that_stands_still_or_a_negative_limit_gives_zero(dt_s, limit):
    assert Pid(PidConfig(kp=1.0)).step(1.0, 0.0, dt_s, 0.0, limit) == 0.0


def test_slope_across_a_bad_measurement_is_not_taken_as_a_jump():
    pid = Pid(PidConfig(kd=1.0))
    pid.step(0.0, 0.0, H, 0.0, NO_LIMIT)
    pid.step(0.0, math.nan, H, 0.0, NO_LIMIT)
    assert pid.step(0.0, 50.0, H, 0.0, NO_LIMIT) == 0.0


def test_huge_values_neither_raise_nor_poison_the_state():
    pid = Pid(PidConfig(kp=50.0, ki=50.0, kd=1.0))
    for value in (1e308, -1e308, 1e300, 5e307):
        assert abs(pid.step(value, -value, H, value, 12.0)) <= 12.0
    pid.reset(1.0)
    assert pid.step(1.0, 1.0, H, 0.0, 12.0) == 0.0


@settings(deadline=None)
@given(speeds, st.floats(-500.0, 500.0))
def test_feedforward_is_odd_and_has_the_motor_equation_outside_the_friction_band(omega, alpha):
    config = PidConfig(kv=0.45, ks=0.3, ka=0.02)
    voltage = feedforward_v(config, omega, alpha)
    assert feedforward_v(config, -omega, -alpha) == pytest.approx(-voltage)
    if abs(omega) >= FRICTION_BAND_RAD_S:
        expected = 0.45 * omega + math.copysign(0.3, omega) + 0.02 * alpha
        assert voltage == pytest.approx(expected)


def test_feedforward_of_rest_is_zero():
    assert feedforward_v(PidConfig(kv=1.0, ks=1.0, ka=1.0), 0.0, 0.0) == 0.0


@pytest.mark.parametrize("name", ["kp", "ki", "kd", "kv", "ks", "ka", "derivative_filter_s"])
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_configuration_refuses_negative_and_non_finite_gains(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        PidConfig(**{name: value})


def test_gains_of_the_default_robot_are_a_configuration():
    path = Path(__file__).parents[2] / "configs" / "diff_drive.toml"
    control = tomllib.loads(path.read_text())["control"]
    assert PidConfig(**control["left"]).kp > 0.0
