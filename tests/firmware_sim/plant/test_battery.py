"""The battery against closed forms."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.config.parameters import BatteryParameters
from firmware_sim.plant.battery import Battery, open_circuit_voltage


def test_a_full_battery_at_rest_shows_its_cells() -> None:
    assert Battery(BatteryParameters(cells=3)).voltage_v == pytest.approx(12.6)
    assert Battery(BatteryParameters(cells=4, voltage_scale=0.7)).voltage_v == pytest.approx(
        4 * 4.2 * 0.7
    )


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_voltage_never_falls_with_charge(a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert open_circuit_voltage(low) <= open_circuit_voltage(high)


def test_current_sags_the_voltage_at_once_and_then_with_the_time_of_polarisation() -> None:
    p = BatteryParameters(capacity_ah=1.0e6, polarisation_time_s=2.0)
    battery = Battery(p)
    battery.step(10.0)
    assert battery.voltage_v == pytest.approx(12.6 - 10.0 * 0.06, abs=1e-3)
    for _ in range(1999):
        battery.step(10.0)
    expected = 12.6 - 0.6 - 0.3 * (1.0 - math.exp(-1.0))
    assert battery.voltage_v == pytest.approx(expected, abs=1e-4)


def test_charge_counts_ampere_hours_both_ways_and_stays_in_range() -> None:
    battery = Battery(BatteryParameters(capacity_ah=0.01, charge=0.5), dt_s=0.1)
    for _ in range(60):
        battery.step(1.0)
    assert battery.charge == pytest.approx(0.5 - 6.0 / 36.0)
    for _ in range(60):
        battery.step(-1.0)
    assert battery.charge == pytest.approx(0.5)
    for _ in range(1000):
        battery.step(1.0)
    assert battery.charge == 0.0
