"""Wheels whose drives close the loop: how soon a fault is found, and in what words."""

from __future__ import annotations

import pytest

from robotctl.messages.faults import FaultCode
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.speed_wheel_monitor import SpeedWheelMonitor

MS = 1_000_000
PERIOD_MS = 5


class Wheel:
    """A wheel whose position always is that of its speed."""

    def __init__(self):
        self.monitor = SpeedWheelMonitor("left", PlausibilityConfig())
        self.now_ms, self.angle_rad = 1000, 0.0

    def turn(self, wanted, speed, most_ms=2000):
        """Report a speed again and again; return when and for what fault the robot stops."""
        for elapsed_ms in range(0, most_ms, PERIOD_MS):
            self.now_ms += PERIOD_MS
            self.angle_rad += speed * PERIOD_MS * 1e-3
            fault = self.monitor.update(wanted, speed, self.angle_rad, self.now_ms * MS)
            if fault is not None:
                assert fault.code is FaultCode.WHEEL_ASTRAY
                assert fault.part == "left"
                return elapsed_ms, fault.text
        return None


@pytest.fixture
def wheel():
    return Wheel()


@pytest.mark.parametrize(
    ("wanted", "speed"), [(4.0, 4.0), (4.0, 1.5), (-4.0, -6.5), (0.0, 1.9), (0.0, 0.0), (1.0, -1.0)]
)
def test_a_wheel_within_its_tolerances_goes_on(wheel, wanted, speed):
    assert wheel.turn(wanted, speed) is None


@pytest.mark.parametrize(
    ("wanted", "speed", "words"),
    [
        (4.0, -4.0, "left wheel turns the wrong way: -4.0 rad/s measured, 4.0 rad/s commanded"),
        (-4.0, 4.0, "left wheel turns the wrong way: 4.0 rad/s measured, -4.0 rad/s commanded"),
        (4.0, 9.0, "left wheel runs away: 9.0 rad/s measured, 4.0 rad/s commanded"),
        (0.0, -3.0, "left wheel runs away: -3.0 rad/s measured, 0.0 rad/s commanded"),
    ],
)
def test_one_that_runs_away_is_found_as_soon_as_a_wrong_encoder(wheel, wanted, speed, words):
    elapsed_ms, text = wheel.turn(wanted, speed)
    assert elapsed_ms == PlausibilityConfig().speed_ms + PERIOD_MS
    assert text.startswith(words)


def test_one_that_stands_after_it_has_followed_is_found_soon(wheel):
    assert wheel.turn(4.0, 4.0, 500) is None
    elapsed_ms, text = wheel.turn(4.0, 0.0)
    assert elapsed_ms == 105
    assert text == (
        "left wheel stands: 0.0 rad/s measured, 4.0 rad/s commanded: it is blocked, or its "
        "encoder is stuck"
    )


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_one_that_starts_slowly_has_time(wheel, speed):
    assert wheel.turn(0.0, 0.0, 500) is None
    elapsed_ms, _ = wheel.turn(5.0, speed)
    assert elapsed_ms == PlausibilityConfig().follow_ms + PERIOD_MS


def test_a_wheel_that_was_commanded_to_rest_has_time_again(wheel):
    assert wheel.turn(4.0, 4.0, 500) is None
    assert wheel.turn(0.0, 0.0, 500) is None
    elapsed_ms, _ = wheel.turn(4.0, 0.0)
    assert elapsed_ms == PlausibilityConfig().follow_ms + PERIOD_MS


def test_a_stop_of_a_fault_forgets(wheel):
    assert wheel.turn(4.0, 4.0, 500) is None
    wheel.monitor.reset()
    elapsed_ms, _ = wheel.turn(4.0, 0.0)
    assert elapsed_ms == PlausibilityConfig().follow_ms + PERIOD_MS
