"""Fits of a wheel whose parameters are known."""

import math

import numpy as np
import pytest

from robotctl.workbench.tuning.fit import (
    step_model,
    wheel_feedforward,
)
from robotctl.workbench.tuning.open_loop import OpenLoopRecord

DT_S = 0.005


def record_of(duty, supply_v, kv, ks, ka, steps=50):
    """A wheel without a delay, integrated in fine steps; volts are constant within a period."""
    omega, angle, angles, speeds = 0.0, 0.0, [], []
    for share in duty:
        angles.append(angle)
        speeds.append(omega)
        for _ in range(steps):
            force_v = share * supply_v - kv * omega
            rubbing_v = ks * math.copysign(1.0, omega) if omega else ks * math.copysign(1.0, share)
            omega += (force_v - rubbing_v) / ka * DT_S / steps
            angle += omega * DT_S / steps
    n = len(duty)
    column = np.array([angles, speeds]).T
    return OpenLoopRecord(
        np.arange(n) * DT_S, np.array(duty), np.full(n, supply_v), column[:, 1:], column[:, :1]
    )


STAIRS = [level for level in (0.4, 0.8, 0.4, 0.8, 0.6, 0.3) for _ in range(140)]


def test_feedforward_of_a_known_wheel_is_found_without_bias():
    fit = wheel_feedforward(record_of(STAIRS, 12.0, 0.5, 0.3, 0.04), 0, 0.0)
    assert fit.kv == pytest.approx(0.5, rel=0.005)
    assert fit.ks == pytest.approx(0.3, rel=0.02)
    assert fit.ka == pytest.approx(0.04, rel=0.01)


def test_the_model_of_a_known_wheel_is_found():
    model = step_model(record_of(STAIRS, 12.0, 0.5, 0.3, 0.04), 0, 0.0)
    assert model.gain == pytest.approx(2.0, rel=0.005)
    assert model.time_constant_s == pytest.approx(0.08, rel=0.02)
    assert model.delay_s < 0.001


def test_a_record_without_a_step_says_nothing():
    with pytest.raises(ValueError, match="no step"):
        step_model(record_of([0.5] * 200, 12.0, 0.5, 0.3, 0.04), 0, 0.0)
