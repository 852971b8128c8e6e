"""A wheel that shall not turn: silent where it stands by itself, held where it would roll away."""

from __future__ import annotations

import numpy as np
import pytest

from robotctl.control.pid import PidConfig
from robotctl.control.pwm import PwmConfig
from robotctl.control.wheel_loop import WheelLoop
from tests.control.conftest import MotorRig

DT_S = 0.005
BUS_V = 12.6
GAINS = PidConfig(kp=0.8, ki=8.0, kv=0.45, ks=0.3, ka=0.036)
ENCODERS = (90, 400, 2400, 20_000)


class Wheel:
    """The loop of the robot on the rig, with one period between latch and command."""

    def __init__(
        self,
        counts_per_revolution: int,
        coulomb_v: float = 0.3,
        gains: PidConfig = GAINS,
        tau_s: float = 0.08,
    ) -> None:
        self.motor = MotorRig(
            tau_s, coulomb_v=coulomb_v, counts_per_revolution=counts_per_revolution
        )
        self.loop = WheelLoop(gains, PwmConfig(deadband=0.02), counts_per_revolution, 100.0)
        self.count_rad = 2.0 * np.pi / counts_per_revolution
        self.blocked = False
        self.loop.estimator.reset(0, 0)
        self.loop.reset()

    def run(self, seconds: float, reference_rad_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return angle [rad] and duty after each tick."""
        rows = []
        for _ in range(round(seconds / DT_S)):
            self.loop.estimator.update(*self.motor.latch())
            duty = self.loop.duty
            self.loop.step(reference_rad_s, BUS_V, DT_S)
            if self.blocked:
                self.motor.time_s += DT_S
            else:
                self.motor.step(duty, BUS_V, DT_S)
            rows.append((self.motor.angle_rad, self.loop.duty))
        angles, duties = np.transpose(rows)
        return angles, duties

    def stop(self) -> None:
        """Drive at 5 rad/s, then come to a reference of zero by a ramp."""
        self.run(1.0, 5.0)
        for reference_rad_s in np.linspace(5.0, 0.0, 40):
            self.run(DT_S, reference_rad_s)


@pytest.mark.parametrize("counts", ENCODERS)
@pytest.mark.parametrize("friction_v", [0.1, 0.3])
def test_a_wheel_that_has_stopped_is_without_voltage_and_stays_where_it_is(counts, friction_v):
    wheel = Wheel(counts, friction_v)
    wheel.stop()
    wheel.run(0.5)
    angles, duties = wheel.run(5.0)
    assert not duties.any()
    assert np.ptp(angles) == 0.0


@pytest.mark.parametrize("counts", ENCODERS)
@pytest.mark.parametrize("load_v", [-0.4, 0.6, 1.5])
@pytest.mark.parametrize("friction_v", [0.0, 0.3])
def test_a_wheel_that_would_roll_away_is_held(counts, load_v, friction_v):
    wheel = Wheel(counts, friction_v)
    wheel.motor.load_v = load_v
    angles, _ = wheel.run(3.0)
    # Until it is found out, and until the integral holds it; a coarse encoder sees it late.
    band_rad = max(0.02, 2.0 * wheel.count_rad)
    assert abs(angles[-1]) < band_rad + 1.3 * abs(load_v) / GAINS.ki + wheel.count_rad
    later, duties = wheel.run(10.0)
    assert np.ptp(later) < max(1.5 * wheel.count_rad, 0.01)
    assert np.mean(duties[-400:]) * load_v < 0.0
    assert np.ptp(duties[-400:]) * BUS_V < 1.5 * GAINS.ki * wheel.count_rad + 0.1


@pytest.mark.parametrize("tau_s", [0.3, 0.6])
def test_a_heavy_robot_with_a_fine_encoder_does_not_rock_where_it_is_held(tau_s):
    kp = 0.45 * tau_s / 0.056  # as `robotctl tune` makes them
    wheel = Wheel(2400, 0.0, PidConfig(kp=kp, ki=kp / 0.225, kv=0.45), tau_s)
    wheel.motor.load_v = 1.0
    wheel.run(10.0)
    angles, _ = wheel.run(10.0)
    assert np.ptp(angles) < 2.0 * wheel.count_rad


@pytest.mark.parametrize("counts", ENCODERS)
def test_a_stop_on_a_slope_lets_the_wheel_go_once_at_most(counts):
    wheel = Wheel(counts)
    wheel.motor.load_v = -1.0
    wheel.stop()
    before, _ = wheel.run(1.0)
    after, _ = wheel.run(10.0)
    assert before[0] - before[-1] < 0.3
    assert np.ptp(after) <= wheel.count_rad


@pytest.mark.parametrize("counts", ENCODERS)
def test_a_blocked_wheel_is_not_pushed_on_when_it_shall_stand(counts):
    wheel = Wheel(counts)
    wheel.blocked = True
    wheel.run(1.0, 5.0)
    assert wheel.loop.duty > 0.5
    wheel.run(0.25)
    assert wheel.loop.duty == 0.0


@pytest.mark.parametrize("counts", ENCODERS)
def test_play_and_a_count_that_flickers_give_no_voltage(counts):
    wheel = Wheel(counts)
    for step in range(400):
        wheel.motor.angle_rad = (step % 2) * max(wheel.count_rad, 0.015)
        _, duties = wheel.run(DT_S)
        assert not duties.any()


def test_the_next_reference_and_the_next_arming_end_the_hold():
    for again in (Wheel.stop, lambda wheel: wheel.loop.reset()):
        wheel = Wheel(2400)
        wheel.motor.load_v = 1.0
        wheel.run(2.0)
        assert wheel.loop.duty < -0.02
        wheel.motor.load_v = 0.0
        again(wheel)
        wheel.run(0.5)
        assert wheel.loop.duty == 0.0


@pytest.mark.parametrize("counts", ENCODERS)
def test_what_has_stopped_a_wheel_is_not_pushed_on_once_it_is_to_stand(counts: int) -> None:
    wheel = Wheel(counts)
    wheel.run(1.0, 5.0)
    wheel.blocked = True
    _, duties = wheel.run(0.4, 5.0)
    assert duties[-1] > 0.3
    _, duties = wheel.run(0.5)
    assert np.flatnonzero(duties)[-1:].sum() * DT_S < 0.05


def test_a_wheel_that_creeps_comes_to_rest_as_one_that_was_fast() -> None:
    wheel = Wheel(2400)
    wheel.run(3.0, 0.08)
    _, duties = wheel.run(3.0)
    assert not duties[round(1.0 / DT_S) :].any()
