"""Bring-up, third step: do the sensors tell the truth?"""

import math

import pytest

from hil_tests.rig import Rig
from robotctl.messages.control import SafetyState


def test_sonars_measure_the_walls_of_the_empty_room(rig: Rig) -> None:
    rig.start()
    rig.wait_for_state(SafetyState.STANDBY)
    rig.wait(
        lambda: rig.control and not any(math.isnan(r) for r in rig.control.sonar_m), 3, "all sonars"
    )
    samples: list[tuple[float, ...]] = []

    def enough() -> bool:
        assert rig.control is not None
        if not samples or samples[-1] != rig.control.sonar_m:
            samples.append(rig.control.sonar_m)
        return len(samples) >= 21

    rig.wait(enough, 10, "21 rings")
    walls = rig.room_distances()
    for index, mount in enumerate(rig.config.sonar):
        expected_m = walls[mount.name]
        median_m = sorted(sample[index] for sample in samples)[len(samples) // 2]
        if expected_m is not None:
            assert median_m == pytest.approx(expected_m, abs=0.03), mount.name


def test_wheel_feedback_comes_once_a_period_and_stands_still_at_rest(rig: Rig) -> None:
    rig.start()
    state = rig.wait_for_state(SafetyState.STANDBY)
    frames = [m for m in rig.heard(1.0) if m.arbitration_id == 0x181]
    assert len(frames) == pytest.approx(rig.config.runtime.rate_hz, rel=0.1)
    assert len({bytes(m.data[4:8]) for m in frames}) == 1
    assert state.distance_m == 0.0


def test_the_battery_reports_a_plausible_voltage_and_charge(rig: Rig) -> None:
    rig.start()
    rig.wait(lambda: rig.control and rig.control.battery, 5, "battery")
    battery = rig.control.battery
    assert 11.0 < battery.voltage_v < 12.7
    assert 0.95 < battery.charge <= 1.0
    assert (battery.low, battery.critical) == (False, False)
    rig.wait(lambda: rig.control.bus_voltage_v > 0, 5, "bus voltage")
    assert rig.control.bus_voltage_v == pytest.approx(battery.voltage_v, abs=0.3)
