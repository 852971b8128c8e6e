from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.wheel_velocity import WheelVelocityEstimator

CPR = 2400
RAD_PER_COUNT = 2.0 * math.pi / CPR
PERIOD_US = 5000
MS_TO_RAD_S = 1.0 / 0.05  # wheel radius 0.05 m


def latches(angles_rad, times_us, offset=0):
    counts = np.floor(np.asarray(angles_rad) / RAD_PER_COUNT).astype(int) + offset
    return [(int(c) & 0xFFFF, int(t) & 0xFFFFF) for c, t in zip(counts, times_us, strict=True)]


def estimates(samples, **options):
    estimator = WheelVelocityEstimator(CPR, **options)
    return np.array([estimator.update(*sample) for sample in samples])


def bare_differences(samples):
    def signed(value, bits):
        return (value + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))

    speeds = [0.0]
    for (c0, t0), (c1, t1) in itertools.pairwise(samples):
        speeds.append(signed(c1 - c0, 16) * RAD_PER_COUNT / ((t1 - t0) % (1 << 20) * 1e-6))
    return np.array(speeds)


def constant_speed(omega_rad_s, seconds=1.0, phase=0.0, period_us=PERIOD_US):
    times_us = np.arange(0, int(seconds * 1e6), period_us)
    return latches(omega_rad_s * times_us * 1e-6 + phase * RAD_PER_COUNT, times_us)


def ripple_ratio(omega_rad_s):
    """How many times larger the bare difference's rms error is, over phases and detunings."""
    bare, ours = 0.0, 0.0
    for phase in np.linspace(0.0, 0.9, 7):
        for detune in (1.0, 1.003, 1.0071):
            samples = constant_speed(omega_rad_s * detune, phase=phase)
            bare += np.sum((bare_differences(samples)[30:] - omega_rad_s * detune) ** 2)
            ours += np.sum((estimates(samples)[30:] - omega_rad_s * detune) ** 2)
    return math.sqrt(bare / ours)


@pytest.mark.parametrize(
    ("speed_m_s", "at_least"), [(0.0025, 5.0), (0.01, 8.0), (0.05, 10.0), (0.1, 10.0), (0.5, 8.0)]
)
def test_ripple_at_constant_speed_is_many_times_below_the_bare_difference(speed_m_s, at_least):
    assert ripple_ratio(speed_m_s * MS_TO_RAD_S) > at_least


@settings(deadline=None)
@given(st.floats(-40.0, 40.0), st.floats(0.0, 1.0))
def test_error_at_constant_speed_is_below_one_count_per_window(omega, phase):
    errors = estimates(constant_speed(omega, 0.3, phase))[20:] - omega
    assert np.max(np.abs(errors)) <= RAD_PER_COUNT / 0.055 + 1e-9


def test_slow_ramp_is_followed_several_times_better_than_by_the_bare_difference():
    times_us = np.arange(0, 1_000_000, PERIOD_US)
    t = times_us * 1e-6
    alpha = 1.0  # 0 to 0.05 m/s in a second
    ratios = []
    for phase in np.linspace(0.0, 0.9, 7):
        samples = latches(0.5 * alpha * t**2 + phase * RAD_PER_COUNT, times_us)
        bare = np.sqrt(np.mean((bare_differences(samples) - alpha * t)[10:] ** 2))
        ours = np.sqrt(np.mean((estimates(samples) - alpha * t)[10:] ** 2))
        ratios.append(bare / ours)
    assert np.median(ratios) > 4.0


@pytest.mark.parametrize("alpha", [20.0, 50.0, 100.0])
def test_delay_in_a_hard_ramp_is_at_most_fifteen_milliseconds(alpha):
    times_us = np.arange(0, 300_000, PERIOD_US)
    t = times_us * 1e-6
    delays = []
    for phase in np.linspace(0.0, 0.9, 7):
        samples = latches(0.5 * alpha * t**2 + phase * RAD_PER_COUNT, times_us)
        delays.append(np.mean((alpha * t - estimates(samples))[20:]) / alpha)
    assert 0.0 < np.mean(delays) < 0.015


@pytest.mark.parametrize("omega", [10.0, -10.0])
def test_an_abrupt_change_is_seen_within_two_samples(omega):
    times_us = np.arange(0, 600_000, PERIOD_US)
    t = times_us * 1e-6
    angle = np.where(t < 0.3, 0.0, omega * (t - 0.3))
    angle = np.where(t > 0.45, angle - 2.0 * omega * (t - 0.45), angle)
    speeds = estimates(latches(angle + 1e-9, times_us))
    assert speeds[60] == 0.0
    one_count = RAD_PER_COUNT / 0.005
    assert speeds[62] == pytest.approx(omega, abs=one_count)
    assert speeds[92] == pytest.approx(-omega, abs=one_count)


def test_a_stop_from_crawling_speed_shows_at_the_first_still_sample_and_ends_at_the_second():
    times_us = np.arange(0, 300_000, PERIOD_US)
    t = times_us * 1e-6
    first, second = [], []
    for phase in np.linspace(0.0, 0.9, 10):
        samples = latches(np.minimum(t, 0.2) + phase * RAD_PER_COUNT, times_us)
        speeds = estimates(samples)
        first.append(speeds[41])
        second.append(speeds[42])
    assert np.mean(first) < 0.8
    assert np.mean(second) < 0.2


@settings(deadline=None)
@given(st.floats(-20.0, 20.0))
def test_a_stop_decays_to_exactly_zero_within_the_window(omega):
    times_us = np.arange(0, 500_000, PERIOD_US)
    t = times_us * 1e-6
    speeds = estimates(latches(omega * np.minimum(t, 0.2), times_us))
    assert np.all(speeds[t > 0.2 + 0.0651] == 0.0)


def test_direction_reversal_through_a_slow_sine():
    times_us = np.arange(0, 2_000_000, PERIOD_US)
    t = times_us * 1e-6
    omega = 1.0 * np.cos(2.0 * math.pi * 0.5 * t)
    samples = latches(np.sin(2.0 * math.pi * 0.5 * t) / (2.0 * math.pi * 0.5), times_us)
    ours = np.sqrt(np.mean((estimates(samples) - omega)[20:] ** 2))
    bare = np.sqrt(np.mean((bare_differences(samples) - omega)[20:] ** 2))
    assert ours < 0.1
    assert bare > 2.0 * ours


@settings(deadline=None, max_examples=50)
@given(st.floats(-60.0, 60.0), st.integers(0, 65535), st.integers(0, (1 << 20) - 1))
def test_roll_over_of_counts_and_time_changes_nothing(omega, count0, time0):
    times_us = np.arange(0, 1_500_000, PERIOD_US)
    plain = latches(omega * times_us * 1e-6, times_us)
    # Unwrapped on purpose: the plain record itself rolls over, this one elsewhere.
    shifted = [((c + count0) & 0xFFFF, (t + time0) & 0xFFFFF) for c, t in plain]
    np.testing.assert_array_equal(estimates(plain), estimates(shifted))


@settings(deadline=None)
@given(st.lists(st.integers(-2200, 2200), min_size=1, max_size=100), st.integers(0, 65535))
def test_position_is_the_sum_of_all_counts(steps, first):
    estimator = WheelVelocityEstimator(CPR)
    estimator.reset(first, 0)
    count = first
    for k, step in enumerate(steps, 1):
        count += step
        estimator.update(count & 0xFFFF, k * 20_000 & 0xFFFFF)
    assert estimator.position_rad == pytest.approx(sum(steps) * RAD_PER_COUNT)
    assert estimator.jumps == 0


@settings(deadline=None, max_examples=50)
@given(st.sets(st.integers(1, 199), max_size=120), st.floats(1.0, 30.0))
def test_lost_samples_do_not_disturb_the_speed(lost, omega):
    samples = [s for k, s in enumerate(constant_speed(omega)) if k not in lost]
    speeds = estimates(samples)[1:]
    # Two samples at the least: one count over one period.
    assert np.max(np.abs(speeds - omega)) <= RAD_PER_COUNT / 0.005 + 1e-9


def test_speed_after_a_long_gap_is_the_mean_over_it():
    estimator = WheelVelocityEstimator(CPR)
    estimator.update(0, 0)
    assert estimator.update(764, 200_000) == pytest.approx(764 * RAD_PER_COUNT / 0.2)


def test_the_same_time_stamp_is_the_same_sample():
    estimator = WheelVelocityEstimator(CPR)
    for sample in constant_speed(10.0, 0.2):
        speed = estimator.update(*sample)
    before = estimator.position_rad
    count, stamp = sample
    assert estimator.update(count, stamp) == speed
    assert estimator.update(count + 40 & 0xFFFF, stamp) == speed
    assert estimator.position_rad == before
    assert estimator.jumps == 0


def test_an_impossible_jump_moves_the_reference_but_not_position_or_speed():
    estimator = WheelVelocityEstimator(CPR)
    samples = constant_speed(10.0, 0.4)
    for sample in samples[:40]:
        speed = estimator.update(*sample)
    position = estimator.position_rad
    moved = [((c + 20_000) & 0xFFFF, t) for c, t in samples[40:]]
    assert estimator.update(*moved[0]) == speed
    assert estimator.position_rad == position
    assert estimator.jumps == 1
    for sample in moved[1:]:
        assert estimator.update(*sample) == pytest.approx(10.0, abs=RAD_PER_COUNT / 0.005)
    assert estimator.jumps == 1


def test_the_first_sample_only_sets_the_reference():
    estimator = WheelVelocityEstimator(CPR)
    assert estimator.update(40_000, 123_456) == 0.0
    assert estimator.position_rad == 0.0
    estimator.update(40_010, 128_456)
    assert estimator.position_rad == pytest.approx(10 * RAD_PER_COUNT)


def test_reset_forgets_position_and_speed():
    estimator = WheelVelocityEstimator(CPR)
    for sample in constant_speed(10.0, 0.2):
        estimator.update(*sample)
    estimator.reset(5, 7)
    assert estimator.position_rad == 0.0
    assert estimator.velocity_rad_s == 0.0
    assert estimator.update(5, 5007) == 0.0


@pytest.mark.parametrize("gap_us", [1_048_576, 1_053_576, 600_000, 5_000_000])
@pytest.mark.parametrize("moved", [0, 300, -300, 32_767, -32_768])
def test_behind_a_gap_the_way_counts_and_the_speed_begins_anew(gap_us, moved):
    estimator = WheelVelocityEstimator(CPR)
    for sample in range(20):
        estimator.update(50 * sample & 0xFFFF, 5000 * sample)
    assert estimator.velocity_rad_s > 0.0
    before_rad = estimator.position_rad
    count, time_us = 50 * 19 + moved, 5000 * 19 + gap_us
    estimator.resume(count & 0xFFFF, time_us & 0xFFFFF)
    assert estimator.velocity_rad_s == 0.0
    assert estimator.update(count & 0xFFFF, time_us & 0xFFFFF) == 0.0
    way_rad = estimator.position_rad - before_rad
    assert way_rad == pytest.approx(moved * 2.0 * math.pi / CPR, abs=1e-9)
    assert estimator.update(count + 50 & 0xFFFF, time_us + 5000 & 0xFFFFF) == pytest.approx(
        50 * 2.0 * math.pi / CPR / 0.005
    )


@pytest.mark.parametrize("period_us", [1000, 2000, 10_000])
def test_other_control_rates_have_the_same_bound_and_react_as_fast(period_us):
    speeds = estimates(constant_speed(1.0, 1.0, period_us=period_us))
    settled = speeds[60_000 // period_us + 2 :]
    assert np.max(np.abs(settled - 1.0)) <= RAD_PER_COUNT / 0.05
    times_us = np.arange(0, 400_000, period_us)
    t = times_us * 1e-6
    speeds = estimates(latches(10.0 * np.minimum(t, 0.2) + 1e-9, times_us))
    assert np.all(np.abs(speeds[t > 0.2 + max(0.012, 1.5e-6 * period_us)]) < 0.3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("counts_per_revolution", 0),
        ("window_s", 0.0),
        ("window_s", 0.6),
        ("band_counts", 0.5),
        ("speed_max_rad_s", 0.0),
        ("speed_max_rad_s", math.nan),
    ],
)
def test_parameters_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        WheelVelocityEstimator(**({"counts_per_revolution": CPR} | {name: value}))
