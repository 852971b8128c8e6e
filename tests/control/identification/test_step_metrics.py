from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.control.identification.step_metrics import step_metrics

T = np.arange(0.0, 5.0, 0.001)


def test_first_order_response_has_its_closed_form_metrics():
    tau = 0.2
    metrics = step_metrics(T, 2.0 * (1.0 - np.exp(-T / tau)), 2.0)
    assert metrics.rise_s == pytest.approx(tau * math.log(9.0), abs=1e-5)
    assert metrics.settling_s == pytest.approx(tau * math.log(50.0), abs=1e-5)
    assert metrics.overshoot == 0.0
    assert metrics.steady_state_error == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("zeta", [0.2, 0.5, 0.7])
def test_second_order_response_has_its_closed_form_overshoot_and_peak_time(zeta):
    wn = 10.0
    wd = wn * math.sqrt(1.0 - zeta**2)
    y = 1.0 - np.exp(-zeta * wn * T) * (np.cos(wd * T) + zeta * wn / wd * np.sin(wd * T))
    metrics = step_metrics(T, y, 1.0)
    assert metrics.overshoot == pytest.approx(
        math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)), abs=1e-4
    )
    assert metrics.peak_s == pytest.approx(math.pi / wd, abs=0.001)
    envelope = math.log(1.0 / (0.02 * math.sqrt(1.0 - zeta**2))) / (zeta * wn)
    assert 0.6 * envelope < metrics.settling_s <= envelope


def test_a_downward_step_from_an_offset_and_a_late_start_mean_the_same():
    y = np.where(T < 1.0, 3.0, 1.0 + 2.0 * np.exp(-(T - 1.0) / 0.2))
    metrics = step_metrics(T, y, 1.0, initial=3.0, step_time_s=1.0)
    assert metrics.rise_s == pytest.approx(0.2 * math.log(9.0), abs=1e-4)
    assert metrics.settling_s == pytest.approx(0.2 * math.log(50.0), abs=1e-4)
    assert metrics.overshoot == 0.0


def test_a_response_that_stays_short_has_no_settling_time_and_a_positive_error():
    metrics = step_metrics(T, 0.8 * (1.0 - np.exp(-T / 0.1)), 1.0)
    assert metrics.rise_s is None
    assert metrics.settling_s is None
    assert metrics.steady_state_error == pytest.approx(0.2)


def test_a_late_excursion_counts_for_settling():
    y = np.where((T > 3.0) & (T < 3.1), 1.05, 1.0)
    assert step_metrics(T, y, 1.0).settling_s == pytest.approx(3.1, abs=0.002)
    assert step_metrics(T, y, 1.0, band=0.1).settling_s == 0.0
    assert step_metrics(T, y, 1.0).overshoot == pytest.approx(0.05)


def test_steady_state_error_averages_the_ripple_of_the_end():
    y = 0.99 + 0.05 * np.sin(2.0 * math.pi * 50.0 * T)
    assert step_metrics(T, y, 1.0).steady_state_error == pytest.approx(0.01, abs=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reference": 0.0}, "reference"),
        ({"band": 0.0}, "band"),
        ({"steady_share": 0.0}, "steady_share"),
        ({"step_time_s": 9.0}, "fewer than two"),
        ({"response": [1.0, 2.0]}, "shapes"),
        ({"response": [1.0, math.nan, 1.0]}, "not finite"),
        ({"time_s": [0.0, 0.0, 1.0]}, "not increasing"),
    ],
)
def test_records_that_make_no_sense_are_refused(change, message):
    arguments = {"time_s": [0.0, 1.0, 2.0], "response": [0.0, 0.5, 1.0], "reference": 1.0}
    with pytest.raises(ValueError, match=message):
        step_metrics(**(arguments | change))
