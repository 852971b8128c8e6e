"""State of the battery."""

import pytest
from pymavlink.dialects.v20 import common

from robotctl.messages.control import (
    BatteryFeedback,
)
from tests.mavlink.services.telemetry.bench import one_of_each


def test_battery_and_system_status_show_the_battery(bench):
    sent = one_of_each(bench)
    battery = sent["BATTERY_STATUS"]
    assert battery.voltages[0] == 12345
    assert battery.voltages[1] == 0xFFFF
    assert (battery.current_battery, battery.battery_remaining) == (150, 80)
    assert battery.temperature == 3125
    assert battery.charge_state == common.MAV_BATTERY_CHARGE_STATE_OK
    status = sent["SYS_STATUS"]
    assert (status.voltage_battery, status.current_battery) == (12345, 150)
    assert status.battery_remaining == 80


@pytest.mark.parametrize(
    ("low", "critical", "expected"),
    [
        (True, False, common.MAV_BATTERY_CHARGE_STATE_LOW),
        (True, True, common.MAV_BATTERY_CHARGE_STATE_CRITICAL),
    ],
)
def test_a_low_battery_is_said(bench, low, critical, expected):
    battery = BatteryFeedback(0, 10.0, 1.0, 0.1, 20.0, low=low, critical=critical)
    sent = one_of_each(bench, battery=battery)
    assert sent["BATTERY_STATUS"].charge_state == expected
    healthy = sent["SYS_STATUS"].onboard_control_sensors_health
    assert bool(healthy & common.MAV_SYS_STATUS_SENSOR_BATTERY) != critical


def test_without_a_battery_its_values_are_unknown(bench):
    sent = one_of_each(bench, battery=None)
    assert "BATTERY_STATUS" not in sent
    assert sent["SYS_STATUS"].voltage_battery == 0xFFFF
    assert sent["SYS_STATUS"].battery_remaining == -1
