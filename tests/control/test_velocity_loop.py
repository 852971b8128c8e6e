"""The velocity loop as a whole, on the motor rig: the quality that the robot must reach."""

from __future__ import annotations

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.control.pid import PidConfig
from robotctl.control.pwm import PwmConfig
from robotctl.model.geometry.twist import Twist

FULL_V = 12.6
RADIUS_M = 0.05
LIMITS = LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0)
PWM = PwmConfig(deadband=0.02, slew_per_s=40.0)


def gains(ka=0.45 * 0.08, kv=0.45, ks=0.3):
    return PidConfig(kp=0.8, ki=8.0, kv=kv, ks=ks, ka=ka)


def speed_step(rig, v_m_s, seconds=1.2):
    """Body speeds after a step of the command, through the limiter."""
    limiter = TwistLimiter(LIMITS)
    speeds = []
    for _ in range(round(seconds / rig.dt_s)):
        v = limiter.step(Twist(v_m_s, 0.0), rig.dt_s).v_m_s
        omega = rig.step(v / RADIUS_M, limiter.acceleration.v_m_s / RADIUS_M)
        speeds.append(omega * RADIUS_M)
    return np.array(speeds)


def settled_after_s(speeds, target, band, dt_s=0.005):
    return (np.flatnonzero(np.abs(speeds / target - 1.0) > band)[-1] + 1) * dt_s


@pytest.mark.parametrize("bus_voltage_v", [FULL_V, 0.7 * FULL_V])
@pytest.mark.parametrize("tau_s", [0.06, 0.08, 0.1])
def test_half_a_metre_per_second_is_there_in_time(wheel_loop_rig, bus_voltage_v, tau_s):
    rig = wheel_loop_rig(gains(ka=0.45 * tau_s), PWM, bus_voltage_v, tau_s=tau_s)
    speeds = speed_step(rig, 0.5)
    assert settled_after_s(speeds, 0.5, 0.02) <= 0.3
    assert np.max(speeds) < 0.5 * 1.02
    assert abs(np.mean(speeds[-60:]) - 0.5) < 0.01 * 0.5
    assert np.std(speeds[-60:]) < 0.005 * 0.5


@pytest.mark.parametrize("tau_s", [0.055, 0.08, 0.1])
@pytest.mark.parametrize("coulomb_v", [0.15, 0.45])
@pytest.mark.parametrize("kv", [0.43, 0.47])
def test_feedback_makes_up_for_a_wrong_feedforward(wheel_loop_rig, tau_s, coulomb_v, kv):
    rig = wheel_loop_rig(gains(kv=kv), PWM, 0.7 * FULL_V, tau_s=tau_s, coulomb_v=coulomb_v)
    speeds = speed_step(rig, 0.5)
    assert settled_after_s(speeds, 0.5, 0.02) <= 0.4
    assert np.max(speeds) < 0.5 * 1.05
    assert abs(np.mean(speeds[-60:]) - 0.5) < 0.01 * 0.5


def test_low_speed_is_kept_steadily(wheel_loop_rig):
    rig = wheel_loop_rig(gains(), PWM)
    speeds = speed_step(rig, 0.05)
    assert np.mean(speeds[-60:]) == pytest.approx(0.05, rel=0.01)
    assert np.std(speeds[-60:]) < 0.01 * 0.05


def test_a_stop_brings_the_wheel_to_rest(wheel_loop_rig):
    rig = wheel_loop_rig(gains(), PWM)
    limiter = TwistLimiter(LIMITS)
    for k in range(400):
        v = limiter.step(Twist(0.5 if k < 160 else 0.0, 0.0), 0.005).v_m_s
        omega = rig.step(v / RADIUS_M, limiter.acceleration.v_m_s / RADIUS_M)
        if k > 160 + 80:
            assert abs(omega) < 0.2
    assert omega == 0.0


def test_a_load_is_worked_off_by_the_integral(wheel_loop_rig):
    rig = wheel_loop_rig(gains(), PWM)
    speed_step(rig, 0.3)
    rig.motor.coulomb_v += 1.5
    speeds = [rig.step(6.0) * RADIUS_M for _ in range(200)]
    assert min(speeds) < 0.27
    assert settled_after_s(np.array(speeds), 0.3, 0.02) < 0.6


def test_saturation_on_a_weak_battery_recovers_without_a_wound_up_integral(wheel_loop_rig):
    rig = wheel_loop_rig(gains(), PWM, bus_voltage_v=7.0)
    for _ in range(400):
        omega = rig.step(20.0)  # needs 9.3 V
    assert omega < 15.5
    down = np.maximum(8.0, 20.0 - 50.0 * 0.005 * np.arange(200))
    speeds = np.array([rig.step(r, -50.0 if r > 8.0 else 0.0) for r in down])
    assert np.min(speeds) > 8.0 * 0.9
    assert settled_after_s(speeds, 8.0, 0.05) < 0.24 + 0.2
