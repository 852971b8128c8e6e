"""Report of the wheel on a VESC, put together from its status messages."""

from __future__ import annotations

import math
import struct
from typing import Final

from robotctl.drivers.can.drives.axis import Axis, Unwrapped
from robotctl.drivers.can.drives.session import Session
from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.state import VescState
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback

PAUSE_NS: Final = 100_000_000
"""Pause of status 1 after which the drive may have restarted [ns]: five of its periods at least."""

_NEVER_COMES_NS: Final = -NEVER_NS

_MOST_OF_TURN: Final = 3
"""Greatest plausible speed of a wheel, in multiples of its maximum; a faster tachometer has been
reset."""

_SLACK_COUNTS: Final = 60
"""Tolerance of that [count], ten electrical turns."""
_UNPACK_STATUS, _UNPACK_STATUS_4 = wire.STATUS_DATA.unpack, wire.STATUS_4_DATA.unpack
_UNPACK_STATUS_5, _UNPACK_SHORT_5 = wire.STATUS_5_DATA.unpack, wire.SHORT_STATUS_5_DATA.unpack
_WANTED: Final = ("status 1 (speed)", "status 5 (tachometer)")


class VescFeedback:
    """Keeps the newest values, and notices in them that the drive has restarted.

    Parameters
    ----------
    session, state
        Of the drive.
    axis
        The wheel.
    pole_pairs
        Of the motor.
    max_rad_s
        Greatest speed of the wheel [rad/s].
    motor_temperature
        Whether the temperature of the motor is told, else that of the bridge.

    Attributes
    ----------
    is_new
        Whether something came since the last `report`.
    since_ns
        When the drive came, or restarted [ns].
    erpm
        Speed [erpm].
    report_ns
        When the drive last answered on faults [ns].
    """

    __slots__ = (
        "_amperes",
        "_axis",
        "_counts_per_ns",
        "_current",
        "_pause_ns",
        "_rad_s_per_erpm",
        "_session",
        "_state",
        "_status_ns",
        "_supply_ns",
        "_tachometer",
        "_temperature_at",
        "_temperature_c",
        "_turns",
        "_turns_per_count",
        "_voltage_v",
        "erpm",
        "is_new",
        "report_ns",
        "since_ns",
    )

    def __init__(
        self,
        session: Session,
        state: VescState,
        axis: Axis,
        pole_pairs: int,
        max_rad_s: float,
        *,
        motor_temperature: bool,
    ) -> None:
        self._session = session
        self._state = state
        self._axis = axis
        self._rad_s_per_erpm = 1.0 / axis.to_motor(60.0 * pole_pairs / math.tau)
        self._amperes = axis.current_a(wire.AMPERES)
        self._turns_per_count = 1.0 / (wire.TACHOMETER_PER_TURN * pole_pairs)
        fastest = _MOST_OF_TURN * abs(axis.to_motor(max_rad_s))
        self._counts_per_ns = fastest / math.tau / self._turns_per_count * 1e-9
        self._temperature_at = 1 if motor_temperature else 0
        self.is_new = False
        self.since_ns = 0
        self._pause_ns = _NEVER_COMES_NS
        """End of the longest pause of status 1 that cannot hide a restart [ns]."""
        self._tachometer: Unwrapped | None = None
        self._turns = 0.0
        self.erpm = 0
        self._current = 0
        self._temperature_c: float | None = None
        self._voltage_v: float | None = None
        self._status_ns = self._supply_ns = self.report_ns = NEVER_NS

    def on_status(self, data: bytes, stamp_ns: int) -> None:
        """Take speed and current of the motor."""
        if stamp_ns > self._pause_ns:
            self.on_boot(data, stamp_ns)
        self._pause_ns = stamp_ns + PAUSE_NS
        self._session.hear(stamp_ns)
        try:
            self.erpm, self._current, _ = _UNPACK_STATUS(data)
        except struct.error:
            self._unreadable("status 1", data)
        else:
            self._status_ns = stamp_ns
            self.is_new = True

    def on_status_4(self, data: bytes, _: int) -> None:
        """Take the temperature."""
        try:
            self._temperature_c = 0.1 * _UNPACK_STATUS_4(data)[self._temperature_at]
        except struct.error:
            self._unreadable("status 4", data)

    def on_status_5(self, data: bytes, stamp_ns: int) -> None:
        """Take tachometer and supply."""
        try:
            count, supply, *_ = (_UNPACK_STATUS_5 if len(data) == 8 else _UNPACK_SHORT_5)(data)
        except struct.error:
            self._unreadable("status 5", data)
            return
        tachometer = self._tachometer
        if tachometer is None:
            tachometer = self._tachometer = Unwrapped(32)
            turned = tachometer.update(count)
        else:
            before = tachometer.value
            turned = tachometer.update(count)
            most = self._counts_per_ns * (stamp_ns - self._supply_ns) + _SLACK_COUNTS
            if not -most <= turned - before <= most:
                self.on_boot(data, stamp_ns)
        self._turns = turned * self._turns_per_count
        self._voltage_v = 0.1 * supply
        self._supply_ns = stamp_ns
        self.is_new = True

    def on_boot(self, _: bytes, stamp_ns: int) -> None:
        """Have the drive commissioned again: it says that it booted, or has a new tachometer."""
        self.forget()
        if not self._session.silent:
            self._session.restart()
        self._session.hear(stamp_ns)

    def forget(self) -> None:
        """Forget the tachometer: the next has nothing to do with it."""
        self._tachometer = None
        self._pause_ns = _NEVER_COMES_NS

    def missing(self) -> str:
        """Name the status messages that have not come since the drive did."""
        came = (self._status_ns > self.since_ns, self._supply_ns > self.since_ns)
        return " and no ".join(name for name, has in zip(_WANTED, came, strict=True) if not has)

    def _unreadable(self, name: str, data: bytes) -> None:
        """Stop a drive that sends a frame of another length than is documented."""
        text = f"{name} has {len(data)} bytes ({data.hex(' ')}), which is not VESC's"
        self._state.unreadable(text)
        self.is_new = True

    def wheel(self) -> ActuatorFeedback:
        """Return the report of the wheel."""
        self.is_new = False
        state, axis = self._state, self._axis
        supply_ns = self._supply_ns
        motion_ns = min(self._status_ns, supply_ns)
        told = motion_ns != NEVER_NS
        return ActuatorFeedback(
            motion_ns,
            -1,
            axis.ticks(self._turns),
            self.erpm * self._rad_s_per_erpm if told else None,
            None,
            self.report_ns,
            state.state,
            state.interlock.fault,
            self._current * self._amperes if told else None,
            self._temperature_c,
            supply_ns,
            self._voltage_v,
        )
