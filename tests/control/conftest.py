"""A wheel with its motor, bridge and encoder, as the control tests need it."""

from __future__ import annotations

import math

import pytest

from robotctl.control.pid import Pid, feedforward_v
from robotctl.control.pwm import PwmMap
from robotctl.control.wheel_velocity import WheelVelocityEstimator


class MotorRig:
    """Quasi-static DC motor at the wheel: R i = V - K w, J dw/dt = K i - Coulomb torque.

    1.2 ohm, K = 0.45 V s/rad (N m/A), Coulomb friction that needs 0.3 V at standstill, inertia for
    the given mechanical time constant, a bridge dead-band and a 2400-count encoder.
    """

    def __init__(self, tau_s=0.08, deadband=0.02, coulomb_v=0.3, counts_per_revolution=2400):
        self.resistance_ohm, self.k = 1.2, 0.45
        self.inertia = tau_s * self.k**2 / self.resistance_ohm
        self.deadband, self.coulomb_v = deadband, coulomb_v
        self.counts_per_revolution = counts_per_revolution
        self.omega_rad_s = self.angle_rad = self.time_s = 0.0
        self.load_v = 0.0  # torque of a slope, as the voltage that balances it

    def effective_v(self, duty, bus_voltage_v):
        effective = max(0.0, abs(duty) - self.deadband) / (1.0 - self.deadband)
        return math.copysign(effective, duty) * bus_voltage_v

    def step(self, duty, bus_voltage_v, dt_s, substeps=20):
        h = dt_s / substeps
        coulomb = self.coulomb_v * self.k / self.resistance_ohm
        voltage = self.effective_v(duty, bus_voltage_v)
        for _ in range(substeps):
            driving_v = voltage + self.load_v - self.k * self.omega_rad_s
            torque = self.k * driving_v / self.resistance_ohm
            before = self.omega_rad_s
            if before == 0.0 and abs(torque) <= coulomb:
                continue
            friction = math.copysign(coulomb, before if before != 0.0 else torque)
            self.omega_rad_s += (torque - friction) / self.inertia * h
            if before * self.omega_rad_s < 0.0:
                self.omega_rad_s = 0.0
            self.angle_rad += 0.5 * (before + self.omega_rad_s) * h
        self.time_s += dt_s

    def latch(self):
        """Counts and time as on the wire."""
        count = math.floor(self.angle_rad / (2.0 * math.pi) * self.counts_per_revolution)
        return count & 0xFFFF, round(self.time_s * 1e6) & 0xFFFFF


class WheelLoopRig:
    """The whole velocity loop on the rig, with one period between latch and command."""

    def __init__(self, pid_config, pwm_config, bus_voltage_v=12.6, dt_s=0.005, **motor):
        self.motor = MotorRig(**motor)
        self.pid, self.pwm = Pid(pid_config), PwmMap(pwm_config)
        self.estimator = WheelVelocityEstimator(self.motor.counts_per_revolution)
        self.bus_voltage_v, self.dt_s = bus_voltage_v, dt_s
        self._duty = 0.0

    def step(self, omega_ref_rad_s, alpha_ref_rad_s2=0.0):
        """One tick: the command computed now acts from the next tick on."""
        measured = self.estimator.update(*self.motor.latch())
        self.motor.step(self._duty, self.bus_voltage_v, self.dt_s)
        # The measurement is as old as the estimator's window, the motor as late as the command.
        delay_s = self.estimator.delay_s + 1.5 * self.dt_s
        voltage = self.pid.step(
            omega_ref_rad_s - alpha_ref_rad_s2 * delay_s,
            measured,
            self.dt_s,
            feedforward_v(self.pid.config, omega_ref_rad_s, alpha_ref_rad_s2),
            self.pwm.voltage_limit_v(self.bus_voltage_v),
        )
        self._duty = self.pwm.step(voltage, self.bus_voltage_v, self.dt_s)
        return self.motor.omega_rad_s


@pytest.fixture(scope="session")
def motor_rig():
    """Factory of the motor alone."""
    return MotorRig


@pytest.fixture(scope="session")
def wheel_loop_rig():
    """Factory of the motor in its velocity loop."""
    return WheelLoopRig
