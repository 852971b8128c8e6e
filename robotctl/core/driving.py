"""Commands for the actuators, made from the wanted body velocity."""

from __future__ import annotations

from typing import Final

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.control.wheels import WheelControl
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import VelocityCommand
from robotctl.messages.faults import Fault
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.twist import Twist
from robotctl.safety.command_guard import Bound, guarded

STOPPED: Final = ActuatorCommand(enable=False, brake=True)
"""Wheels without power brake; joints stay where they are."""
_REST: Final = Twist(0.0, 0.0)
_HELD_M_S: Final = 0.1
"""Maximum speed by which a robot that is braking to a stop lags its reference [m/s]: if it lags
more, something holds it."""


class Driving:
    """Set-point, limiter, inverse kinematics and wheel loops of a powered robot.

    Parameters
    ----------
    drive, wheels
        Kinematics, and the loop of each driven wheel.
    limits
        Of the set-point limiter.
    bounds
        What each actuator may be commanded.
    setpoint_timeout_ms
        An older set-point is void [ms].
    period_ns
        Control period [ns].

    Attributes
    ----------
    velocity
        The newest set-point; None: there is none, or a stop has made it void.
    reference
        Output of the limiter.
    """

    def __init__(
        self,
        drive: Drive,
        wheels: tuple[WheelControl, ...],
        limits: LimitsConfig,
        bounds: tuple[Bound, ...],
        setpoint_timeout_ms: int,
        period_ns: int,
    ) -> None:
        self.velocity: VelocityCommand | None = None
        self.reference = _REST
        self._drive = drive
        self._wheels = wheels
        self._limiter = TwistLimiter(limits)
        self._bounds = bounds
        self._setpoint_limit_ns = setpoint_timeout_ms * 1_000_000
        self._period_s = period_ns * 1e-9
        self._armed_ns = 0
        """Time of the last arming [ns]."""

    def retune(self, limits: LimitsConfig) -> None:
        """Change the limits of the set-point."""
        self._limiter.retune(limits)

    def take_over(self, twist_meas: Twist, now_ns: int) -> None:
        """Start from the present motion, so that arming causes no jump."""
        self.velocity = None
        self._armed_ns = now_ns
        self._limiter.reset(twist_meas)
        for wheel in self._wheels:
            wheel.reset()

    def stopped(self) -> ActuatorCommand:
        """Return the command that brakes the wheels and leaves joints where they are."""
        self.reference = _REST
        return STOPPED

    def follow_setpoint(self, twist_meas: Twist, now_ns: int) -> bool:
        """Move the reference towards the set-point; return whether that is a motion."""
        wanted = self._setpoint(now_ns)
        if wanted == _REST:
            self._yield(twist_meas)
        self.reference = self._limiter.step(wanted, self._period_s)
        return wanted != _REST

    def _yield(self, twist_meas: Twist) -> None:
        """Lower the reference of a robot that is braking to a stop and has hit something.

        Following the ramp of its limits it would push against that, and its wheel loops would wind
        up and push even once the ramp has ended.
        """
        limiter = self._limiter
        v_m_s, _, vy_m_s = limiter.twist
        speed_m_s = limiter.twist.speed_m_s
        if speed_m_s <= _HELD_M_S:
            return
        along_m_s = (v_m_s * twist_meas.v_m_s + vy_m_s * twist_meas.vy_m_s) / speed_m_s
        share = max(along_m_s + _HELD_M_S, 0.0) / speed_m_s
        if share < 1.0:
            # Scaled as a whole, the robot stays on its arc and can still stop without overshoot.
            limiter.reset(limiter.twist.scaled(share), limiter.acceleration.scaled(share))

    def command(
        self, joints_rad: tuple[float, ...], reports: tuple[ActuatorFeedback, ...]
    ) -> ActuatorCommand | Fault:
        """Close the wheel loops on the reference; a fault where the command guard refuses.

        Parameters
        ----------
        joints_rad
            Measured angle of each joint [rad].
        reports
            Newest of all actuators, wheels first, with the supply of their drives.
        """
        wanted, dt_s = self._drive.inverse(self.reference, joints_rad), self._period_s
        wheels = zip(self._wheels, wanted.wheels_rad_s, reports, strict=False)
        values = [
            wheel.step(speed, report.voltage_v or 0.0, dt_s) for wheel, speed, report in wheels
        ]
        return self.guarded((*values, *wanted.joints_rad))

    def guarded(self, values: tuple[float, ...]) -> ActuatorCommand | Fault:
        """Return the command that drives; a fault where the command guard refuses a value."""
        allowed = guarded(values, self._bounds)
        return allowed if isinstance(allowed, Fault) else ActuatorCommand(True, False, allowed)

    def _setpoint(self, now_ns: int) -> Twist:
        """Return the velocity to command now; zero if the set-point is missing or expired."""
        velocity = self.velocity
        if velocity is None or now_ns > velocity.expires_ns:
            return _REST
        if velocity.stamp_ns < self._armed_ns:  # who wanted it did not know of the arming
            return _REST
        age_ns = now_ns - velocity.stamp_ns
        if not 0 <= age_ns <= self._setpoint_limit_ns:
            return _REST
        return velocity.twist
