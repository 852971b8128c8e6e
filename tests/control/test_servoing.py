from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.servoing import ServoConfig, gain_limit, gain_without_overshoot, servo

H = 0.05


def largest_pole(loop_gain, delay_steps):
    polynomial = np.zeros(delay_steps + 2)
    polynomial[0], polynomial[1] = 1.0, -1.0
    polynomial[-1] += loop_gain
    return np.max(np.abs(np.roots(polynomial)))


def run(kp, delay_steps, plant_gain=1.0, steps=400, z0=1.0):
    """Distance z to a wall, approached by servoing the speed on it."""
    config = ServoConfig(kp=kp, direction=-1)
    z, demands, out = z0, [0.0] * delay_steps, []
    for _ in range(steps):
        demands.append(servo(config, 0.0, z))
        z -= plant_gain * H * demands.pop(0)
        out.append(z)
    return np.array(out)


@pytest.mark.parametrize("delay_steps", [0, 1, 2, 5, 10])
def test_gain_limit_puts_the_poles_on_the_unit_circle(delay_steps):
    kp = gain_limit(2.0, H, delay_steps)
    loop_gain = kp * 2.0 * H
    assert largest_pole(loop_gain, delay_steps) == pytest.approx(1.0, abs=1e-9)
    assert largest_pole(0.98 * loop_gain, delay_steps) < 1.0
    assert largest_pole(1.02 * loop_gain, delay_steps) > 1.0


@pytest.mark.parametrize("delay_steps", [0, 1, 3])
def test_the_loop_converges_below_the_limit_and_swings_up_above_it(delay_steps):
    kp = gain_limit(1.0, H, delay_steps)
    assert np.max(np.abs(run(0.9 * kp, delay_steps)[-20:])) < 0.1
    assert np.max(np.abs(run(1.1 * kp, delay_steps)[-20:])) > 10.0


@pytest.mark.parametrize("delay_steps", [0, 1, 2, 5])
def test_the_gain_without_overshoot_does_not_pass_the_reference(delay_steps):
    kp = gain_without_overshoot(1.0, H, delay_steps)
    assert np.min(run(kp, delay_steps)) >= -1e-9
    assert np.min(run(1.2 * kp, delay_steps)) < -1e-5
    assert run(kp, delay_steps)[-1] < 1e-3


@pytest.mark.parametrize("direction", [1, -1])
def test_the_direction_decides_between_convergence_and_flight(direction):
    z = 1.0
    config = ServoConfig(kp=2.0, direction=direction, limit=0.5)
    for _ in range(200):
        z += direction * H * servo(config, 3.0, z)
    assert z == pytest.approx(3.0, abs=1e-6)
    z = 1.0
    for _ in range(200):
        z -= direction * H * servo(config, 3.0, z)
    assert z < 0.0


@settings(deadline=None)
@given(st.floats(), st.floats())
def test_the_demand_is_finite_and_within_its_limit(reference, reading):
    demand = servo(ServoConfig(kp=3.0, direction=1, limit=0.7), reference, reading)
    assert abs(demand) <= 0.7


def test_errors_within_the_tolerance_give_no_demand():
    config = ServoConfig(kp=1.0, direction=1, tolerance=0.1)
    assert servo(config, 1.0, 0.95) == 0.0
    assert servo(config, 1.0, 0.85) == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("name", "value"),
    [("kp", 0.0), ("kp", math.nan), ("direction", 0), ("limit", 0.0), ("tolerance", -1.0)],
)
def test_configuration_refuses_values_out_of_range(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        ServoConfig(**({"kp": 1.0, "direction": 1} | {name: value}))


@pytest.mark.parametrize("bound", [gain_limit, gain_without_overshoot])
@pytest.mark.parametrize(
    ("arguments", "name"),
    [((0.0, H, 1), "plant_gain"), ((1.0, -H, 1), "dt_s"), ((1.0, H, -1), "delay_steps")],
)
def test_gain_bounds_refuse_what_is_no_plant(bound, arguments, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        bound(*arguments)
