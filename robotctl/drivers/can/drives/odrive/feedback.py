"""Report of the wheel on an ODrive, put together from its messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.odrive.wire import FLOATS
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback, DriveState
from robotctl.messages.faults import Fault

_TURN: Final = 2.0 * math.pi
_INF: Final = math.inf
_UNPACK: Final = FLOATS.unpack


class Feedback:
    """Keeps the newest values.

    Parameters
    ----------
    axis
        The wheel.
    unreadable
        Takes name, data and reason of a message that says nothing.

    Attributes
    ----------
    is_new
        Whether something came since the last `report`.
    state_ns
        When the axis last told its state [ns].
    """

    __slots__ = (
        "_axis",
        "_current_a",
        "_motion_ns",
        "_supply_ns",
        "_temperature_c",
        "_turns",
        "_turns_per_s",
        "_unreadable",
        "_voltage_v",
        "is_new",
        "state_ns",
    )

    def __init__(self, axis: Axis, unreadable: Callable[[str, bytes, str], None]) -> None:
        self.is_new = True
        self.state_ns = NEVER_NS
        self._axis = axis
        self._unreadable = unreadable
        self._motion_ns = self._supply_ns = NEVER_NS
        self._turns = self._turns_per_s = 0.0
        self._current_a: float | None = None
        self._temperature_c: float | None = None
        self._voltage_v: float | None = None

    def on_estimates(self, data: bytes, stamp_ns: int) -> None:
        """Take position and speed of the motor."""
        if len(data) != 8:
            self._unreadable("encoder estimate", data, "it has 8 bytes")
            return
        turns, turns_per_s = _UNPACK(data)
        # False for nan, too.
        if -_INF < turns < _INF and -_INF < turns_per_s < _INF:
            self._turns, self._turns_per_s = turns, turns_per_s
            self._motion_ns = stamp_ns
            self.is_new = True
        else:
            self._unreadable("encoder estimate", data, f"{turns} turns at {turns_per_s} turn/s")

    def on_current(self, data: bytes, _: int) -> None:
        """Take the current that gives the torque."""
        pair = self._pair("motor current", data)
        if pair is not None:
            self._current_a = self._axis.current_a(pair[1])

    def on_voltage(self, data: bytes, stamp_ns: int) -> None:
        """Take the voltage of the supply."""
        pair = self._pair("bus voltage", data)
        if pair is not None:
            self._voltage_v, self._supply_ns = pair[0], stamp_ns

    def on_temperature(self, data: bytes, _: int) -> None:
        """Take the hotter of bridge and motor; a motor without a sensor has no number."""
        if len(data) != 8:
            self._unreadable("temperature", data, "it has 8 bytes")
            return
        told = [each for each in _UNPACK(data) if math.isfinite(each)]
        self._temperature_c = max(told, default=None)
        self.is_new = True

    def _pair(self, name: str, data: bytes) -> tuple[float, float] | None:
        """Return the two numbers of a message; None if it has not got them."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return None
        first, second = _UNPACK(data)
        if not (-_INF < first < _INF and -_INF < second < _INF):
            self._unreadable(name, data, f"{first} and {second}")
            return None
        self.is_new = True
        return first, second

    def report(self, state: DriveState, fault: Fault | None) -> ActuatorFeedback:
        """Return the report of the newest values."""
        self.is_new = False
        axis, motion_ns = self._axis, self._motion_ns
        return ActuatorFeedback(
            motion_ns,
            -1,
            axis.ticks(self._turns),
            None if motion_ns == NEVER_NS else axis.to_wheel(self._turns_per_s * _TURN),
            None,
            self.state_ns,
            state,
            fault,
            self._current_a,
            self._temperature_c,
            self._supply_ns,
            self._voltage_v,
            None,
        )
