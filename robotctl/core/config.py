"""Settings of the wheel loops, and the speeds that they imply."""

from __future__ import annotations

from dataclasses import dataclass, field

from robotctl.control.limiter import LimitsConfig
from robotctl.control.pid import PidConfig
from robotctl.control.pwm import PwmConfig
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.twist import Twist

_IMPOSSIBLE_SHARE = 2.0
"""Factor on a wheel's speed at the robot's limits, and when pushed, beyond which it cannot turn."""
_PUSHED_M_S = 1.5
"""How fast people push or carry a robot [m/s]."""


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """Loops of the wheels whose drives take a duty.

    Parameters
    ----------
    pwm
        Their bridges.
    left, right
        Loops of a differential drive.
    drive
        Loop of a drive-and-steer robot.
    wheel
        Loop of each wheel that has none of its own.
    """

    pwm: PwmConfig = field(default_factory=PwmConfig)
    left: PidConfig | None = None
    right: PidConfig | None = None
    drive: PidConfig | None = None
    wheel: PidConfig | None = None

    def loops(self, wheel_names: tuple[str, ...]) -> tuple[PidConfig, ...]:
        """Return the loops of the named wheels.

        Raises
        ------
        ValueError
            If one is missing, or one is given for a wheel that needs none.
        """
        if problems := self.wrong_loops(wheel_names):
            raise ValueError("\n".join(f"control.{name}: {why}" for name, why in problems))
        given = self._loops()
        loops = (given.get(name) or self.wheel for name in wheel_names)
        return tuple(loop for loop in loops if loop is not None)

    def powerless(self, wheel_names: tuple[str, ...]) -> tuple[Fault, ...]:
        """Return a reason against arming for each wheel that its gains would not turn."""
        return tuple(
            Fault(
                FaultCode.NO_GAINS,
                f"control.{name}: kp, ki and kv are 0, the wheel would not turn: find gains with "
                "`robotctl tune`",
                name,
            )
            for name, pid in zip(wheel_names, self.loops(wheel_names), strict=True)
            if not pid.can_drive
        )

    def wrong_loops(self, wheel_names: tuple[str, ...]) -> list[tuple[str, str]]:
        """Return which loops are missing or too many for the named wheels, each with the reason."""
        given, wheels = self._loops(), ", ".join(wheel_names) or "none"
        return [
            (name, f"missing, this drive has the wheels {wheels}")
            for name in wheel_names
            if given.get(name) is None and self.wheel is None
        ] + [
            (name, f"this drive has no such wheel with a duty, only {wheels}")
            for name, loop in given.items()
            if loop is not None and name not in wheel_names
        ]

    def _loops(self) -> dict[str, PidConfig | None]:
        return {"left": self.left, "right": self.right, "drive": self.drive}


def fastest_wheel_rad_s(drive: Drive, limits: LimitsConfig) -> float:
    """Return how fast a wheel turns at all speed limits at once [rad/s]."""
    corners = (
        drive.inverse(Twist(limits.v_max_m_s, limits.omega_max_rad_s, vy), drive.joint_max_rad)
        for vy in (limits.vy_max_m_s, -limits.vy_max_m_s)
    )
    return max(abs(speed) for corner in corners for speed in corner.wheels_rad_s)


def impossible_wheel_rad_s(drive: Drive, limits: LimitsConfig) -> float:
    """Return a speed that no wheel of this robot has [rad/s]: counts that need it are wrong."""
    pushed_rad_s = _PUSHED_M_S / min(drive.wheel_radii_m)
    return _IMPOSSIBLE_SHARE * fastest_wheel_rad_s(drive, limits) + pushed_rad_s
