from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.limiter import LimitsConfig, TwistLimiter, scale_to_limits
from robotctl.model.geometry.twist import Twist

H = 0.005
LIMITS = LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0)
V_AXIS = (0.8, 2.5, 30.0)
OMEGA_AXIS = (2.5, 8.0, 100.0)

setpoints = st.one_of(st.floats(-3.0, 3.0), st.floats())
sequences = st.lists(st.tuples(setpoints, setpoints, st.integers(1, 40)), min_size=1, max_size=12)


def run(limiter, targets, dt_s=H):
    """Outputs for a list of (v, omega, number of steps)."""
    return np.array([limiter.step(Twist(v, w), dt_s) for v, w, n in targets for _ in range(n)])


def assert_within(values, start, dt_s, limits, rtol=1e-9):
    v_max, a_max, j_max = limits
    dt_s = np.broadcast_to(dt_s, len(values))
    accelerations = np.diff(np.concatenate([[start], values])) / dt_s
    jerks = np.diff(np.concatenate([[0.0], accelerations])) / dt_s
    # The differences of rounded values: one ulp of the speed over the step, and again.
    ulp = np.spacing(v_max) / dt_s
    assert np.all(np.abs(values) <= v_max * (1.0 + rtol) + 1e-9)
    assert np.all(np.abs(accelerations) <= a_max * (1.0 + rtol) + 4.0 * ulp)
    assert np.all(np.abs(jerks) <= j_max * (1.0 + rtol) + 16.0 * ulp / dt_s)


@settings(deadline=None, max_examples=300)
@given(sequences)
def test_no_sequence_of_setpoints_breaks_a_limit(targets):
    out = run(TwistLimiter(LIMITS), targets)
    assert np.all(np.isfinite(out))
    assert_within(out[:, 0], 0.0, H, V_AXIS)
    assert_within(out[:, 1], 0.0, H, OMEGA_AXIS)


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(setpoints, setpoints, st.floats(1e-3, 0.05)), min_size=1, max_size=200))
def test_no_sequence_of_step_lengths_breaks_a_limit(steps):
    limiter = TwistLimiter(LIMITS)
    out = np.array([limiter.step(Twist(v, w), dt_s) for v, w, dt_s in steps])
    dt = np.array([step[2] for step in steps])
    assert_within(out[:, 0], 0.0, dt, V_AXIS)
    assert_within(out[:, 1], 0.0, dt, OMEGA_AXIS)


@given(
    st.floats(-0.8, 0.8),
    st.floats(-0.8, 0.8),
    st.floats(0.1, 10.0),
    st.floats(0.5, 200.0),
    st.floats(1e-3, 0.02),
)
def test_a_setpoint_is_reached_without_overshoot_and_kept(start, target, a_max, j_max, dt):
    limiter = TwistLimiter(LimitsConfig(0.8, 1.0, a_max, 1.0, j_max, 1.0))
    limiter.reset(Twist(start, 0.0))
    # Trapezoidal bound of the time, and the steps lost to sampling.
    seconds = abs(target - start) / a_max + 2.0 * max(
        a_max / j_max, math.sqrt(abs(target - start) / j_max)
    )
    out = run(limiter, [(target, 0.0, math.ceil(seconds / dt) + 12)], dt)[:, 0]
    low, high = min(start, target) - 1e-9, max(start, target) + 1e-9
    assert np.all((out >= low) & (out <= high))
    assert out[-1] == pytest.approx(target, abs=1e-6)


@pytest.mark.parametrize(
    ("a_max", "j_max", "target", "closed_form_s"),
    [
        (2.5, 30.0, 0.5, 0.5 / 2.5 + 2.5 / 30.0),  # reaches a_max
        (2.5, 10.0, 0.1, 2.0 * math.sqrt(0.1 / 10.0)),  # never does
    ],
)
def test_time_to_the_setpoint_is_that_of_the_s_curve(a_max, j_max, target, closed_form_s):
    limiter = TwistLimiter(LimitsConfig(0.8, 1.0, a_max, 1.0, j_max, 1.0))
    out = run(limiter, [(target, 0.0, 20_000)], 1e-4)[:, 0]
    arrived = np.flatnonzero(out < 0.999 * target)[-1] * 1e-4
    assert arrived <= closed_form_s + 1e-3
    assert arrived >= closed_form_s - math.sqrt(2.0 * 0.001 * target / j_max) - 1e-3
    peak = np.max(np.diff(out)) / 1e-4
    assert peak == pytest.approx(min(a_max, math.sqrt(target * j_max)), rel=0.01)


def test_a_slowly_moving_setpoint_is_followed_with_the_lag_of_its_stopping_way():
    limiter = TwistLimiter(LIMITS)
    t = np.arange(0.0, 4.0, H)
    wanted = 0.4 * np.sin(t)  # 0.4 m/s2, 0.4 m/s3: far inside the limits
    out = np.array([limiter.step(Twist(v, 0.0), H).v_m_s for v in wanted])
    assert np.max(np.abs(out - wanted)[40:]) <= 0.4**2 / (2.0 * 30.0)


def test_a_setpoint_that_moves_up_is_never_overshot():
    limiter = TwistLimiter(LIMITS)
    rng = np.random.default_rng(3)
    target = 0.0
    for _ in range(400):
        target = min(0.8, target + rng.exponential(0.004))
        assert limiter.step(Twist(target, 0.0), H).v_m_s <= target + 1e-9


@settings(deadline=None)
@given(st.floats(-5.0, 5.0), st.floats(-20.0, 20.0))
def test_a_setpoint_too_fast_keeps_its_curvature(v, omega):
    scaled = scale_to_limits(Twist(v, omega), LIMITS)
    assert abs(scaled.v_m_s) <= 0.8
    assert abs(scaled.omega_rad_s) <= 2.5
    assert scaled.v_m_s * omega == pytest.approx(scaled.omega_rad_s * v, abs=1e-9)
    assert scaled.v_m_s * v >= 0.0
    if abs(v) <= 0.8 and abs(omega) <= 2.5:
        assert scaled == (v, omega, 0.0)


def test_both_axes_end_on_the_wanted_arc_when_both_saturate():
    out = run(TwistLimiter(LIMITS), [(2.0, 5.0, 400)])[-1]
    assert out[0] == pytest.approx(0.8)
    assert out[1] == pytest.approx(2.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_setpoint_that_is_no_number_stops_both_axes(bad, axis):
    limiter = TwistLimiter(LIMITS)
    run(limiter, [(0.5, 1.0, 200)])
    target = [0.5, 1.0]
    target[axis] = bad
    out = run(limiter, [(*target, 200)])
    assert out[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert np.all(out >= -1e-9)


def test_reset_goes_on_from_the_present_speed_without_a_bump():
    limiter = TwistLimiter(LIMITS)
    run(limiter, [(-0.8, -2.0, 30)])
    limiter.reset(Twist(0.3, -1.0))
    assert limiter.twist == (0.3, -1.0, 0.0)
    assert limiter.acceleration == (0.0, 0.0, 0.0)
    out = run(limiter, [(0.0, 0.0, 100)])
    assert_within(out[:, 0], 0.3, H, V_AXIS)
    assert_within(out[:, 1], -1.0, H, OMEGA_AXIS)


@pytest.mark.parametrize(
    ("speed", "share"),
    [(9.0, 1.0), (-9.0, -1.0), (math.nan, 0.0), (math.inf, 0.0), (-math.inf, 0.0)],
)
def test_reset_beyond_the_limits_is_clamped(speed, share):
    limiter = TwistLimiter(LIMITS)
    limiter.reset(Twist(speed, 0.25))
    assert limiter.twist == (share * 0.8, 0.25, 0.0)
    limiter.reset(Twist(0.25, speed))
    assert limiter.twist == (0.25, share * 2.5, 0.0)


def test_accelerations_are_those_of_the_last_step():
    limiter = TwistLimiter(LIMITS)
    before = limiter.twist
    for _ in range(30):
        after = limiter.step(Twist(0.8, -2.0), H)
        assert limiter.acceleration.v_m_s == pytest.approx((after.v_m_s - before.v_m_s) / H)
        assert limiter.acceleration.omega_rad_s == pytest.approx(
            (after.omega_rad_s - before.omega_rad_s) / H
        )
        before = after


@pytest.mark.parametrize("dt", [0.0, -0.005, math.nan, math.inf])
def test_a_step_without_time_changes_nothing(dt):
    limiter = TwistLimiter(LIMITS)
    run(limiter, [(0.8, 1.0, 10)])
    before = limiter.twist
    acceleration = limiter.acceleration
    for target in (Twist(0.0, 0.0), Twist(0.8, 1.0), before):
        assert limiter.step(target, dt) == before
        assert limiter.acceleration == acceleration


def test_a_set_point_at_the_bound_is_reached_and_one_ulp_beyond_is_not_passed():
    limiter = TwistLimiter(LIMITS)
    out = run(limiter, [(math.nextafter(0.8, 1.0), 0.0, 400), (-0.8, 0.0, 400)])[:, 0]
    assert out[399] == pytest.approx(0.8, abs=1e-9)
    assert out[-1] == pytest.approx(-0.8, abs=1e-9)


def test_first_step_uses_the_whole_jerk_and_no_more():
    limiter = TwistLimiter(LIMITS)
    assert limiter.step(Twist(0.8, 0.0), H).v_m_s == pytest.approx(30.0 * H * H)
    limiter.step(Twist(0.8, 0.0), H)
    assert limiter.acceleration.v_m_s == pytest.approx(2.0 * 30.0 * H)


@pytest.mark.parametrize("name", ["v_max_m_s", "alpha_max_rad_s2", "angular_jerk_max_rad_s3"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_configuration_refuses_limits_that_are_none(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        LimitsConfig(**{name: value})
