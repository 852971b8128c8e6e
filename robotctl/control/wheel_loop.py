"""The velocity loop of one wheel: estimate, PID with feed-forward, PWM mapping."""

from __future__ import annotations

import math

from robotctl.control.pid import Pid, PidConfig, feedforward_v
from robotctl.control.pwm import PwmConfig, PwmMap
from robotctl.control.wheel_velocity import WheelVelocityEstimator

_REST_S = 0.2
"""Time within its band after which a wheel is at rest [s]; coasting from there stays within it."""
_REST_COUNTS = 1.5
"""Band of rest of a coarse encoder, whose count may flicker between two values [counts]."""
_REST_RAD = 0.02
"""Band of rest of a fine encoder [rad]: play and tyres move a wheel once the torque is removed."""
_LOOP_DELAY_PERIODS = 1.5
"""Dead time of the loop [periods]: one from latch to use, and half as the mean command age."""


class WheelLoop:
    """Turns a wheel-speed reference into a duty.

    Parameters
    ----------
    pid, pwm
        Configuration of the loop and of the bridge.
    counts_per_revolution
        Quadrature counts per turn of the wheel.
    impossible_rad_s
        Maximum possible wheel speed of this robot [rad/s], > 0.
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
        counts_rad = _REST_COUNTS * 2.0 * math.pi / counts_per_revolution
        self._band_rad = max(counts_rad, _REST_RAD)
        self._coarse = counts_rad > _REST_RAD
        self._config = pid
        self._pid = Pid(pid)
        self._pwm = PwmMap(pwm)
        self.reset()

    def reset(self) -> None:
        """Reset integral and slew; the next reference continues the present speed."""
        self.reference_rad_s = self.estimator.velocity_rad_s
        self._alpha_rad_s2 = 0.0
        self.duty = 0.0
        self._pid.reset(self.estimator.velocity_rad_s)
        self._pwm.reset()
        self._stand_rad = self.estimator.position_rad
        """Centre of the band: the angle where rest began, or where the wheel left the last band."""
        self._still_s = _REST_S
        """Time within the band so far [s], up to `_REST_S`."""
        self._holds = False
        """Whether it rolled away from rest, so that the integral holds it."""
        self._wanted = False
        """Whether motion was commanded in the last step."""

    def step(self, reference_rad_s: float, bus_voltage_v: float, dt_s: float) -> float:
        """Return the duty [-1, 1] for a wheel reference [rad/s] at a supply [V].

        At rest with reference zero the output is exactly zero, so that no integral hums against
        static friction or pushes against an obstacle; immediately if something was already holding
        the wheel. A wheel that then rolls away, as on a slope, is held by the integral until
        another reference comes; it has rolled by about the holding voltage over ki.
        """
        measured_rad_s = self.estimator.velocity_rad_s
        before_rad_s = self.reference_rad_s
        self.reference_rad_s = reference_rad_s
        wanted = reference_rad_s != 0.0 or before_rad_s != 0.0
        if self._rests(dt_s, wanted=wanted):
            self._pid.reset(measured_rad_s)
            self._pwm.reset()
            self.duty = 0.0
            return 0.0
        self._alpha_rad_s2 = alpha_rad_s2 = (reference_rad_s - before_rad_s) / dt_s
        # The measurement is late by half the estimator's window plus the bus latency. Compare it
        # with the reference of that time, otherwise every ramp winds up the integral.
        age_s = self.estimator.delay_s + _LOOP_DELAY_PERIODS * dt_s
        voltage_v = self._pid.step(
            reference_rad_s - alpha_rad_s2 * age_s,
            measured_rad_s,
            dt_s,
            self._feedforward_v(),
            self._pwm.voltage_limit_v(bus_voltage_v),
        )
        self.duty = self._pwm.step(voltage_v, bus_voltage_v, dt_s)
        return self.duty

    def _feedforward_v(self) -> float:
        """Return the feed-forward of the reference [V]."""
        config = self._config
        feedforward = feedforward_v(config, self.reference_rad_s, self._alpha_rad_s2)
        if self._coarse and self._holds and self._still_s >= _REST_S:
            # A flickering count would jolt kp's output; at rest only the integral holds the wheel.
            feedforward += config.kp * self.estimator.velocity_rad_s
        return feedforward

    def retune(self, pid: PidConfig) -> None:
        """Change the gains without a bump: the voltage of the last step stays."""
        self._config = pid
        self._pid.set_gains(pid, self._feedforward_v())

    def _rests(self, dt_s: float, *, wanted: bool) -> bool:
        """Return whether the wheel is at rest without torque; `wanted`: motion is commanded."""
        position_rad = self.estimator.position_rad
        if self._wanted and not wanted:
            self._stand_rad = position_rad
        self._wanted = wanted
        left = abs(position_rad - self._stand_rad) > self._band_rad
        if wanted:
            self._holds = False
        elif left and self._still_s >= _REST_S:
            self._holds = True
        if left:
            self._stand_rad = position_rad
            self._still_s = 0.0
        elif self._still_s < _REST_S:  # also while commanded to turn, if something holds it
            self._still_s += dt_s
            if self._still_s >= _REST_S:
                self._stand_rad = position_rad
        return self._still_s >= _REST_S and not (wanted or self._holds)
