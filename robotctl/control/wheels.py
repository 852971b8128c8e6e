"""Interface of a driven wheel to control, whoever closes its speed loop."""

from __future__ import annotations

from typing import Protocol

from robotctl.control.pid import PidConfig


class VelocityEstimator(Protocol):
    """Velocity and position of one wheel, from the positions that its drive reports.

    Attributes
    ----------
    velocity_rad_s
        Present velocity [rad/s].
    jumps
        Number of positions that would need an impossible speed, so far.
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

    def update(self, ticks: int, stamp_us: int, told_rad_s: float | None) -> float:
        """Take a position and the velocity that the drive tells [rad/s]; return the velocity."""


class WheelControl(Protocol):
    """Turns the reference of a wheel into what its drive takes.

    Attributes
    ----------
    reference_rad_s
        The last reference [rad/s].
    """

    reference_rad_s: float

    @property
    def estimator(self) -> VelocityEstimator:
        """Velocity and position of the wheel."""

    def reset(self) -> None:
        """Forget the past; the next reference is taken as continuing the present speed."""

    def step(self, reference_rad_s: float, supply_v: float, dt_s: float) -> float:
        """Return the command for a reference [rad/s] at a supply [V], a period [s] later."""

    def retune(self, pid: PidConfig) -> None:
        """Change the gains without a bump."""
