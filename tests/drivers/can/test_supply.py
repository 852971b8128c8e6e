"""The supply as drives tell it: the lowest voltage counts, and a sag is no empty battery."""

import math

from robotctl.drivers.can.config import PowerConfig
from robotctl.drivers.can.supply import SAG_NS, DriveSupply
from robotctl.messages.actuators import ActuatorFeedback

LIMITS = PowerConfig("drives", low_v=24.0, critical_v=22.0)
S = 1_000_000_000


def told(stamp_ns, *voltages_v):
    return [ActuatorFeedback(supply_ns=stamp_ns, voltage_v=each) for each in voltages_v]


def test_the_lowest_voltage_counts_and_charge_and_current_are_not_known():
    battery = DriveSupply(LIMITS).update(told(S, 25.0, None, 24.5))
    assert (battery.stamp_ns, battery.voltage_v) == (S, 24.5)
    assert math.isnan(battery.charge)
    assert math.isnan(battery.current_a)
    assert not battery.low


def test_what_was_told_already_is_no_report_and_neither_is_silence():
    supply = DriveSupply(LIMITS)
    assert supply.update(told(0, None)) is None
    assert supply.update(told(S, 25.0)) is not None
    assert supply.update(told(S, 25.0)) is None
    assert supply.update(told(S, None)) is None


def test_a_battery_is_low_or_critical_only_when_it_stays_under_the_limit():
    supply = DriveSupply(LIMITS)
    flags = []
    for step in range(60):
        now_ns = S + step * 100_000_000
        voltage_v = 25.0 if step in (0, 15) else 21.0
        battery = supply.update(told(now_ns, voltage_v))
        flags.append((battery.low, battery.critical))
    sagging = 15 + SAG_NS // 100_000_000
    assert not any(any(each) for each in flags[: sagging + 1])
    assert all(all(each) for each in flags[sagging + 1 :])
