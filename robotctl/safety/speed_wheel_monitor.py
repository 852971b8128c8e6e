"""Command, speed and position of one wheel whose drive closes its own loop."""

from __future__ import annotations

from typing import Final

from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.duty_wheel_monitor import REST_RAD_S
from robotctl.safety.persistence import PersistenceTimer
from robotctl.safety.plausibility_config import PlausibilityConfig

WINDOW_NS: Final = 200_000_000
"""Time over which the speed told is compared with the way of the position [ns]."""

GAP_NS: Final = 100_000_000
"""A longer gap between two reports restarts the comparison [ns]."""

STANDING_NS: Final = 100_000_000
"""Longest time for which a wheel that has followed its command may stand against it [ns]."""

SHARE: Final = 0.5
"""The position must move by this share of what the speed says at least, and by its inverse at
most."""


class SpeedWheelMonitor:
    """Watches whether a wheel follows its command, and whether speed and position agree.

    Parameters
    ----------
    name
        Name of the wheel.
    config
        Tolerances.

    Attributes
    ----------
    excess
        Speed minus its command, as a multiple of the tolerance.
    is_against
        Whether the wheel turns against its command.
    """

    def __init__(self, name: str, config: PlausibilityConfig) -> None:
        self.name = name
        self._config = config
        self._follow_ns = config.follow_ms * 1_000_000
        self._runs_away_ns = config.speed_ms * 1_000_000
        self.reset()

    def reset(self) -> None:
        """Reset the timers."""
        self.excess, self.is_against = 0.0, False
        self._astray, self._stands, self._runs_away = (PersistenceTimer() for _ in range(3))
        self._has_followed = False
        """Whether it turned as commanded since it was last commanded to rest."""
        self._begin(0.0, 0)

    def _begin(self, position_rad: float, stamp_ns: int) -> None:
        """Begin to compare speed and position."""
        self._first_rad, self._first_ns = position_rad, stamp_ns
        self._last_ns = stamp_ns
        self._told_rad = 0.0

    def update(
        self, wanted_rad_s: float, speed_rad_s: float, position_rad: float, stamp_ns: int
    ) -> Fault | None:
        """Take one report of an enabled wheel; return the contradiction that it shows.

        Parameters
        ----------
        wanted_rad_s
            Commanded speed [rad/s].
        speed_rad_s, position_rad
            Speed [rad/s] and angle [rad] that the drive reports.
        stamp_ns
            Time of the report [ns].
        """
        return self._follows(wanted_rad_s, speed_rad_s, stamp_ns) or self._agrees(
            speed_rad_s, position_rad, stamp_ns
        )

    def _follows(self, wanted_rad_s: float, speed_rad_s: float, stamp_ns: int) -> Fault | None:
        """Return a fault if the wheel has not followed its command for too long."""
        config = self._config
        faster_rad_s = max(abs(wanted_rad_s), abs(speed_rad_s))
        allowed_rad_s = config.speed_tolerance_rad_s + config.speed_tolerance_share * faster_rad_s
        self.excess = excess = (speed_rad_s - wanted_rad_s) / allowed_rad_s
        # False for nan, which counts as astray.
        near = abs(excess) <= 1.0
        turns = abs(speed_rad_s) >= REST_RAD_S
        if abs(wanted_rad_s) < REST_RAD_S:
            self._has_followed = False
        elif near and turns:
            self._has_followed = True
        # A loop that is told a wrong speed accelerates: that cannot wait for slow starts.
        self.is_against = against = turns and wanted_rad_s * speed_rad_s < 0.0
        runs_away = not near and turns and (against or abs(speed_rad_s) > abs(wanted_rad_s))
        stands = not near and not turns and self._has_followed
        lasting = (
            (self._runs_away.lasts_ns(runs_away, stamp_ns), self._runs_away_ns),
            (self._stands.lasts_ns(stands, stamp_ns), STANDING_NS),
            (self._astray.lasts_ns(not near, stamp_ns), self._follow_ns),
        )
        if all(lasts_ns <= most_ns for lasts_ns, most_ns in lasting):
            return None
        found = f"{speed_rad_s:.1f} rad/s measured, {wanted_rad_s:.1f} rad/s commanded"
        if against:
            text = f"{self.name} wheel turns the wrong way: {found}: check encoder and motor leads"
        elif runs_away:
            text = f"{self.name} wheel runs away: {found}"
        elif not turns:
            text = f"{self.name} wheel stands: {found}: it is blocked, or its encoder is stuck"
        else:
            text = f"{self.name} wheel does not follow: {found}"
        return Fault(FaultCode.WHEEL_ASTRAY, text, self.name)

    def _agrees(self, speed_rad_s: float, position_rad: float, stamp_ns: int) -> Fault | None:
        """Return a fault if the position does not move as the speed says."""
        elapsed_ns = stamp_ns - self._last_ns
        if self._first_ns == 0 or elapsed_ns > GAP_NS:
            self._begin(position_rad, stamp_ns)
            return None
        self._last_ns = stamp_ns
        self._told_rad += speed_rad_s * elapsed_ns * 1e-9
        window_s = (stamp_ns - self._first_ns) * 1e-9
        if window_s * 1e9 < WINDOW_NS:
            return None
        told_rad, moved_rad = self._told_rad, position_rad - self._first_rad
        self._begin(position_rad, stamp_ns)
        least_rad = self._config.speed_tolerance_rad_s * window_s
        if max(abs(told_rad), abs(moved_rad)) <= least_rad:
            return None
        if told_rad * moved_rad > 0.0 and SHARE <= abs(moved_rad / told_rad) <= 1.0 / SHARE:
            return None
        code = FaultCode.ENCODER_STUCK if moved_rad == 0.0 else FaultCode.ENCODER_WRONG
        text = (
            f"{self.name} wheel's position moved by {moved_rad:.2f} rad in {window_s:.2f} s, its "
            f"speed says {told_rad:.2f} rad"
        )
        return Fault(code, text, self.name)
