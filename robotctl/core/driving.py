"""From the body velocity asked for to the command of the wheels."""

from __future__ import annotations

from typing import Final

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.control.wheel_loop import WheelLoop
from robotctl.messages.control import VelocityCommand, WheelCommand
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.twist import Twist
from robotctl.safety.command_guard import guard_command

_REST: Final = Twist(0.0, 0.0)


class Driving:
    """Set-point, limiter, inverse kinematics and wheel loops of a powered robot.

    Parameters
    ----------
    drive, wheels
        Kinematics, and the loop of each driven wheel.
    limits
        Of the set-point limiter.
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
        wheels: tuple[WheelLoop, ...],
        limits: LimitsConfig,
        setpoint_timeout_ms: int,
        period_ns: int,
    ) -> None:
        self.velocity: VelocityCommand | None = None
        self.reference = _REST
        self._steering_max_rad = max(drive.joint_max_rad, default=0.0)
        self._drive = drive
        self._wheels = wheels
        self._limiter = TwistLimiter(limits)
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

    def stopped(self, steering_rad: float) -> WheelCommand:
        """Return the command that brakes the wheels and leaves the steering where it is."""
        self.reference = _REST
        return WheelCommand(False, True, 0.0, 0.0, steering_rad)

    def follow_setpoint(self, now_ns: int) -> bool:
        """Move the reference towards the set-point; return whether that is a motion."""
        wanted = self._setpoint(now_ns)
        self.reference = self._limiter.step(wanted, self._period_s)
        return wanted != _REST

    def command(
        self, steering_rad: float, steering_before_rad: float, bus_voltage_v: float
    ) -> WheelCommand | Fault:
        """Close the wheel loops on the reference; a fault where the command guard refuses.

        Parameters
        ----------
        steering_rad
            Measured steering angle [rad].
        steering_before_rad
            That of the last command [rad].
        bus_voltage_v
            Supply of the bridges [V].
        """
        wanted = self._drive.inverse(self.reference, (steering_rad,))
        dt_s = self._period_s
        duties = [
            wheel.step(speed, bus_voltage_v, dt_s)
            for wheel, speed in zip(self._wheels, wanted.wheels_rad_s, strict=True)
        ]
        duty1, duty2 = duties if len(duties) == 2 else (duties[0], 0.0)
        steering = wanted.joints_rad[0] if wanted.joints_rad else 0.0
        return self.guarded(duty1, duty2, steering, steering_before_rad)

    def guarded(
        self, duty1: float, duty2: float, steering_rad: float, steering_before_rad: float
    ) -> WheelCommand | Fault:
        """Return the command that drives; a fault where the command guard refuses.

        Parameters
        ----------
        duty1, duty2
            Duties [-1, 1].
        steering_rad
            Steering angle [rad].
        steering_before_rad
            That of the last command [rad].
        """
        guarded = guard_command(
            True, duty1, duty2, steering_rad, self._steering_max_rad, steering_before_rad
        )
        if guarded.fault:
            return Fault(FaultCode.COMMAND_GUARD, f"command guard: {guarded.fault}")
        return WheelCommand(True, False, guarded.duty1, guarded.duty2, guarded.steering_rad)

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
