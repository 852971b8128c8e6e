"""The velocity loop of one wheel: estimate, PID with feed-forward, PWM mapping."""

from __future__ import annotations

import math

from robotctl.control.pid import Pid, PidConfig, feedforward_v
from robotctl.control.pwm import PwmConfig, PwmMap
from robotctl.control.wheel_velocity import WheelVelocityEstimator

_REST_WINDOW_S = 0.03
_LOOP_DELAY_PERIODS = 1.5
"""One period from latch to use, and half a period as the mean age of the command it meets."""


class WheelLoop:
    """Turns a wheel-speed reference into a duty.

    Parameters
    ----------
    pid, pwm
        Configuration of the loop and of the bridge.
    counts_per_revolution
        Quadrature counts of the encoder for one turn of the wheel.
    impossible_rad_s
        No wheel of this robot turns faster, whatever happens to it [rad/s], > 0.
    """

    def __init__(
        self,
        pid: PidConfig,
        pwm: PwmConfig,
        counts_per_revolution: int,
        impossible_rad_s: float,
    ) -> None:
        self.estimator = WheelVelocityEstimator(
            counts_per_revolution, speed_max_rad_s=impossible_rad_s
        )
        self.reference_rad_s = 0.0
        self.duty = 0.0
        # Slower than one count in this time is rest, as far as the encoder can tell.
        self._rest_rad_s = 2.0 * math.pi / counts_per_revolution / _REST_WINDOW_S
        self._config = pid
        self._pid = Pid(pid)
        self._pwm = PwmMap(pwm)

    def reset(self) -> None:
        """Forget integral and slew; the next reference is taken as continuing the present speed."""
        self.reference_rad_s = self.estimator.velocity_rad_s
        self.duty = 0.0
        self._pid.reset(self.estimator.velocity_rad_s)
        self._pwm.reset()

    def step(self, reference_rad_s: float, bus_voltage_v: float, dt_s: float) -> float:
        """Return the duty [-1, 1] for a wheel reference [rad/s] at a supply [V].

        At rest with reference zero the output is exactly zero, so that no integral hums against
        static friction.
        """
        measured_rad_s = self.estimator.velocity_rad_s
        before_rad_s = self.reference_rad_s
        self.reference_rad_s = reference_rad_s
        at_rest = abs(measured_rad_s) < self._rest_rad_s
        if at_rest and reference_rad_s == 0.0 and before_rad_s == 0.0:
            self._pid.reset(measured_rad_s)
            self._pwm.reset()
            self.duty = 0.0
            return 0.0
        alpha_rad_s2 = (reference_rad_s - before_rad_s) / dt_s
        # The measurement is old by half the estimator's window and by the way over the bus: the
        # reference of that time belongs to it, else every ramp would wind up the integral.
        age_s = self.estimator.delay_s + _LOOP_DELAY_PERIODS * dt_s
        voltage_v = self._pid.step(
            reference_rad_s - alpha_rad_s2 * age_s,
            measured_rad_s,
            dt_s,
            feedforward_v(self._config, reference_rad_s, alpha_rad_s2),
            self._pwm.voltage_limit_v(bus_voltage_v),
        )
        self.duty = self._pwm.step(voltage_v, bus_voltage_v, dt_s)
        return self.duty
