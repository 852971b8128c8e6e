"""Filters of raw ranges against textbook loops, and what they promise about bursts and delay."""

from __future__ import annotations

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.ranging.reading_filters import RunningMedian, Smoothing

READINGS = st.lists(
    st.lists(
        st.one_of(st.floats(0.02, 5.0), st.just(math.inf), st.just(math.nan)),
        min_size=3,
        max_size=3,
    ),
    min_size=1,
    max_size=25,
)


@given(READINGS, st.sampled_from([1, 3, 5, 7]))
def test_the_median_is_that_of_the_last_readings_of_each_sensor_alone(rows, window):
    median = RunningMedian(3, window)
    for n, row in enumerate(rows, 1):
        found = median.update(np.array(row))
        for k in range(3):
            fired = [r[k] for r in rows[:n] if not math.isnan(r[k])][-window:]
            wanted = statistics.median_low(fired) if fired else math.nan
            assert found[k] == wanted or (math.isnan(found[k]) and math.isnan(wanted))


@given(READINGS, st.floats(0.05, 1.0))
def test_smoothing_is_the_textbook_recursion_begun_anew_after_a_missing_echo(rows, gain):
    smoothing = Smoothing(3, gain)
    means = [math.nan] * 3
    for row in rows:
        found = smoothing.update(np.array(row))
        for k, z in enumerate(row):
            if math.isnan(z):
                continue
            known = math.isfinite(means[k]) and math.isfinite(z)
            means[k] = (1.0 - gain) * means[k] + gain * z if known else z
        np.testing.assert_allclose(found, means, rtol=1e-12)


@pytest.mark.parametrize("window", [3, 5, 9])
def test_a_burst_as_long_as_the_latency_vanishes_and_a_longer_one_does_not(window):
    for length, vanishes in (((window - 1) // 2, True), ((window + 1) // 2, False)):
        median = RunningMedian(1, window)
        assert median.latency_readings == (window - 1) // 2
        readings = [2.0] * window + [math.inf] * length + [2.0] * window
        out = [median.update(np.array([z]))[0] for z in readings]
        assert all(z == 2.0 for z in out) is vanishes


@pytest.mark.parametrize("window", [1, 3, 7])
def test_a_step_comes_out_whole_and_as_late_as_stated(window):
    median = RunningMedian(1, window)
    out = [median.update(np.array([z]))[0] for z in [1.0] * 20 + [3.0] * 20]
    assert out == [1.0] * (20 + median.latency_readings) + [3.0] * (20 - median.latency_readings)


def test_smoothing_follows_a_ramp_as_late_as_stated():
    smoothing = Smoothing(1, 0.25)
    out = [smoothing.update(np.array([0.01 * i]))[0] for i in range(300)]
    assert 0.01 * 299 - out[-1] == pytest.approx(0.01 * smoothing.latency_readings)


def test_smoothing_calms_white_noise_as_stated():
    rng = np.random.default_rng(1)
    smoothing = Smoothing(500, 0.3)
    out = np.array([smoothing.update(z) for z in 2.0 + 0.1 * rng.standard_normal((200, 500))])
    assert out[100:].std() == pytest.approx(0.1 * math.sqrt(0.3 / 1.7), rel=0.02)


@pytest.mark.parametrize("make", [lambda: RunningMedian(2, 3), lambda: Smoothing(2, 0.5)])
def test_reset_forgets_all(make):
    used = make()
    for z in (1.0, 2.0, 4.0):
        used.update(np.array([z, math.inf]))
    used.reset()
    fresh = make()
    for z in (3.0, math.nan, 5.0):
        row = np.array([math.nan, z])
        np.testing.assert_array_equal(used.update(row), fresh.update(row))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: RunningMedian(0), "sensors"),
        (lambda: RunningMedian(2, 4), "window must be odd"),
        (lambda: RunningMedian(2, 0), "window"),
        (lambda: Smoothing(0), "sensors"),
        (lambda: Smoothing(2, 0.0), "gain"),
        (lambda: Smoothing(2, math.nan), "gain"),
        (lambda: Smoothing(2).update(np.zeros(3)), "each of 2 sensors"),
        (lambda: RunningMedian(2).update(np.zeros((2, 1))), "each of 2 sensors"),
    ],
)
def test_what_makes_no_sense_is_refused(make, word):
    with pytest.raises(ValueError, match=word):
        make()
