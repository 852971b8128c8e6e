"""A wheel whose drive closes its own velocity loop."""

from __future__ import annotations

import math
from typing import Final

from robotctl.control.pid import PidConfig

_ROLL_OVER_US: Final = (1 << 20) - 1


class ReportedVelocity:
    """Velocity of a wheel as reported by its drive, and its position.

    Parameters
    ----------
    ticks_per_revolution
        Unit of the position, > 0.
    speed_max_rad_s
        Maximum possible speed [rad/s], > 0. A position that would need a higher one becomes a new
        reference: the angle stays, `jumps` counts it.

    Attributes
    ----------
    velocity_rad_s
        Newest velocity [rad/s].
    jumps
        Number of impossible positions so far.
    """

    __slots__ = ("_jump_ticks_per_us", "_rad_per_tick", "_stamp_us", "_ticks", "_total",
                 "jumps", "velocity_rad_s")  # fmt: skip

    def __init__(self, ticks_per_revolution: int, speed_max_rad_s: float) -> None:
        self._rad_per_tick = 2.0 * math.pi / ticks_per_revolution
        self._jump_ticks_per_us = speed_max_rad_s * 1e-6 / self._rad_per_tick
        self.jumps = 0
        self.reset(0, 0)

    @property
    def position_rad(self) -> float:
        """Angle turned since `reset` [rad]."""
        return self._total * self._rad_per_tick

    def reset(self, ticks: int, stamp_us: int) -> None:
        """Restart at this position: velocity 0, angle 0."""
        self._total = 0
        self.velocity_rad_s = 0.0
        self._ticks, self._stamp_us = ticks, stamp_us

    def resume(self, ticks: int, stamp_us: int) -> None:
        """Continue after a gap of unknown length, whose turn counts."""
        self._total += ticks - self._ticks
        self.velocity_rad_s = 0.0
        self._ticks, self._stamp_us = ticks, stamp_us

    def update(self, ticks: int, stamp_us: int, reported_rad_s: float | None) -> float:
        """Take a position, its time [us, rolling over at 2^20] and a reported velocity [rad/s]."""
        elapsed_us = (stamp_us - self._stamp_us) & _ROLL_OVER_US
        step = ticks - self._ticks
        self._ticks, self._stamp_us = ticks, stamp_us
        # One tick more, since the readings at both ends are rounded.
        if abs(step) > self._jump_ticks_per_us * elapsed_us + 1.0:
            self.jumps += 1
        else:
            self._total += step
        if reported_rad_s is not None:
            self.velocity_rad_s = reported_rad_s
        return self.velocity_rad_s


class SpeedWheel:
    """Passes the reference of a wheel to the drive, which closes the loop.

    Parameters
    ----------
    ticks_per_revolution, speed_max_rad_s
        As for `ReportedVelocity`.
    """

    def __init__(self, ticks_per_revolution: int, speed_max_rad_s: float) -> None:
        self.estimator = ReportedVelocity(ticks_per_revolution, speed_max_rad_s)
        self.reset()

    def reset(self) -> None:
        """Treat the next reference as continuing the present speed."""
        self.reference_rad_s = self.estimator.velocity_rad_s

    def step(self, reference_rad_s: float, supply_v: float, dt_s: float) -> float:  # noqa: ARG002 - all wheels share one signature
        """Return the speed to command, equal to the reference [rad/s]."""
        self.reference_rad_s = reference_rad_s
        return reference_rad_s

    def retune(self, pid: PidConfig) -> None:
        """Do nothing: the drive has its own gains."""
