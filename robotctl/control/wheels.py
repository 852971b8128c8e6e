"""Interface of a driven wheel, with the speed loop in control or in its drive."""

from __future__ import annotations

from typing import Protocol

from robotctl.control.pid import PidConfig


class VelocityEstimator(Protocol):
    """Velocity and position of one wheel, from the reports of its drive.

    Attributes
    ----------
    velocity_rad_s
        Present velocity [rad/s].
    jumps
        Number of positions so far that would need an impossible speed.
    """

    velocity_rad_s: float
    jumps: int

    @property
    def position_rad(self) -> float:
        """Angle turned since `reset` [rad], unwrapped."""

    def reset(self, ticks: int, stamp_us: int) -> None:
        """Restart at a position [ticks] and time [us, rolls over at 2^20]: velocity 0, angle 0."""

    def resume(self, ticks: int, stamp_us: int) -> None:
        """Continue after a gap of unknown length: the angle counts, the velocity restarts at 0."""

    def update(self, ticks: int, stamp_us: int, reported_rad_s: float | None) -> float:
        """Take a position and the drive's reported velocity [rad/s]; return the velocity."""


class WheelControl(Protocol):
    """Turns the reference of a wheel into a command of its drive.

    Attributes
    ----------
    reference_rad_s
        Last reference [rad/s].
    """

    reference_rad_s: float

    @property
    def estimator(self) -> VelocityEstimator:
        """Velocity and position of the wheel."""

    def reset(self) -> None:
        """Reset; the next reference continues the present speed."""

    def step(self, reference_rad_s: float, supply_v: float, dt_s: float) -> float:
        """Return the command for a reference [rad/s] at a supply [V], a period [s] later."""

    def retune(self, pid: PidConfig) -> None:
        """Change the gains without a bump."""
