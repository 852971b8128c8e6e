from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.pwm import PwmConfig, PwmMap

NO_SLEW = PwmConfig(deadband=0.05, slew_per_s=math.inf)
voltages = st.floats(-30.0, 30.0)
buses = st.floats(6.0, 30.0)


@settings(deadline=None)
@given(voltages, buses, st.floats(0.0, 0.5))
def test_voltage_behind_the_dead_band_is_the_wanted_one(motor_rig, voltage, bus, deadband):
    duty = PwmMap(PwmConfig(deadband=deadband, slew_per_s=math.inf)).step(voltage, bus, 0.005)
    wanted = max(-bus, min(bus, voltage))
    seen = motor_rig(deadband=deadband).effective_v(duty, bus)
    assert seen == pytest.approx(wanted, abs=1.1e-4 * bus)
    assert abs(duty) <= 1.0


def test_a_demand_just_above_zero_jumps_the_dead_band_and_zero_does_not():
    pwm = PwmMap(NO_SLEW)
    assert pwm.step(0.01, 12.0, 0.005) == pytest.approx(0.05, abs=0.001)
    assert pwm.step(-0.01, 12.0, 0.005) == pytest.approx(-0.05, abs=0.001)
    assert pwm.step(0.0, 12.0, 0.005) == 0.0
    assert pwm.step(1e-9, 12.0, 0.005) == 0.0


def test_a_weak_battery_gets_a_larger_duty_for_the_same_voltage():
    pwm = PwmMap(PwmConfig(slew_per_s=math.inf))
    assert pwm.step(6.0, 12.0, 0.005) == pytest.approx(0.5)
    assert pwm.step(6.0, 8.0, 0.005) == pytest.approx(0.75)


def test_below_the_voltage_floor_the_duty_grows_no_further():
    pwm = PwmMap(PwmConfig(slew_per_s=math.inf, min_bus_voltage_v=6.0))
    assert pwm.step(3.0, 0.5, 0.005) == pytest.approx(0.5)


@settings(deadline=None)
@given(st.lists(voltages, min_size=1, max_size=50), st.floats(0.1, 100.0), st.floats(1e-4, 0.02))
def test_effective_duty_never_changes_faster_than_the_slew_limit(demands, slew, dt):
    deadband = 0.05
    pwm = PwmMap(PwmConfig(deadband=deadband, slew_per_s=slew))
    last = 0.0
    for demand in demands:
        duty = pwm.step(demand, 12.0, dt)
        effective = math.copysign(max(0.0, abs(duty) - deadband) / (1.0 - deadband), duty)
        assert abs(effective - last) <= slew * dt + 1.1e-4
        last = effective


def test_slew_limit_reaches_full_duty_in_its_time():
    pwm = PwmMap(PwmConfig(slew_per_s=40.0))
    duties = [pwm.step(12.0, 12.0, 0.005) for _ in range(6)]
    assert duties == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, 1.0])
    assert pwm.step(-12.0, 12.0, 0.005) == pytest.approx(0.8)


def test_reset_starts_the_slew_from_zero():
    pwm = PwmMap(PwmConfig(slew_per_s=40.0))
    for _ in range(5):
        pwm.step(12.0, 12.0, 0.005)
    pwm.reset()
    assert pwm.step(12.0, 12.0, 0.005) == pytest.approx(0.2)


@settings(deadline=None)
@given(voltages, buses)
def test_duty_is_bounded_and_the_voltage_limit_says_where(voltage, bus):
    config = PwmConfig(deadband=0.1, slew_per_s=math.inf, max_duty=0.6)
    pwm = PwmMap(config)
    duty = pwm.step(voltage, bus, 0.005)
    assert abs(duty) <= 0.6 + 1e-12
    limit = pwm.voltage_limit_v(bus)
    assert abs(pwm.step(limit, bus, 0.005)) == pytest.approx(0.6)
    assert abs(pwm.step(0.99 * limit, bus, 0.005)) < 0.6


@pytest.mark.parametrize(
    ("voltage", "bus", "dt"),
    [
        (math.nan, 12.0, 0.005),
        (math.inf, 12.0, 0.005),
        (5.0, math.nan, 0.005),
        (5.0, math.inf, 0.005),
        (5.0, 0.0, 0.005),
        (5.0, -12.0, 0.005),
        (5.0, 12.0, 0.0),
        (5.0, 12.0, math.nan),
    ],
)
def test_bad_input_is_zero_duty_at_once(voltage, bus, dt):
    pwm = PwmMap(PwmConfig(slew_per_s=40.0))
    for _ in range(5):
        pwm.step(12.0, 12.0, 0.005)
    assert pwm.step(voltage, bus, dt) == 0.0
    assert pwm.step(12.0, 12.0, 0.005) == pytest.approx(0.2)


@pytest.mark.parametrize("bus", [0.0, -1.0, math.nan, math.inf])
def test_voltage_limit_of_an_unknown_supply_is_zero(bus):
    assert PwmMap(PwmConfig()).voltage_limit_v(bus) == 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("deadband", -0.1),
        ("deadband", 1.0),
        ("deadband", math.nan),
        ("slew_per_s", 0.0),
        ("slew_per_s", math.nan),
        ("max_duty", 0.0),
        ("max_duty", 1.01),
        ("min_bus_voltage_v", 0.0),
        ("min_bus_voltage_v", math.inf),
    ],
)
def test_configuration_refuses_values_out_of_range(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        PwmConfig(**{name: value})
