"""Axis of an ODrive as the host drives it: what to ask of it next, and what its answers mean."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.odrive.wire import AXIS_CLOSED_LOOP, AXIS_IDLE
from robotctl.messages.actuators import NEVER_NS

STOP: Final = 0
"""Ask for idle: the axis has power, or may have."""
REST: Final = 1
"""Keep a set-point of 0, which feeds the watchdog: the axis is idle."""
ENTER: Final = 2
"""Ask for closed-loop velocity control."""
WAIT: Final = 3
"""Keep a set-point of 0 until the axis says that it is in closed-loop control."""
DRIVE: Final = 4
"""Send the commanded speed."""

SETTLE_NS: Final = 250_000_000
"""Time within which a heartbeat shows the state asked for [ns]: each 100 ms one comes."""

STALE_NS: Final = 10_000_000
"""Time within which a message may have been on its way when the request was sent [ns]."""


class AxisMachine:
    """Follows an axis from idle to closed-loop control and back; does no I/O.

    Attributes
    ----------
    axis_state
        State that the axis reported last; 0 if it did not.
    confirmed
        Whether it reported closed-loop control after it was asked for that.
    """

    __slots__ = ("_asked", "_asked_ns", "_may_enable", "axis_state", "confirmed")

    def __init__(self) -> None:
        self.axis_state = 0
        self.confirmed = False
        self._asked = False
        """Whether closed-loop control is asked for."""
        self._asked_ns = NEVER_NS
        self._may_enable = False
        """Whether a command without power came since the axis was last kept from having any."""

    def next(self, now_ns: int, *, enable: bool, ready: bool) -> int:
        """Return what to ask of the axis: `STOP`, `REST`, `ENTER`, `WAIT` or `DRIVE`.

        Parameters
        ----------
        now_ns
            Present time [ns].
        enable
            Whether the command allows power.
        ready
            Whether the drive is in service and nothing is latched.
        """
        if enable and ready and self._may_enable:
            if self.confirmed:
                return DRIVE
            # Asked again while it is in closed-loop control, the axis would leave it for a moment.
            if self._asked and now_ns - self._asked_ns < SETTLE_NS:
                return WAIT
            self._asked, self._asked_ns = True, now_ns
            return ENTER
        self._asked = self.confirmed = False
        # A command to rest counts before the axis is ready, too: it may become so in the very tick
        # in which the robot is armed.
        self._may_enable = not enable or (ready and self._may_enable)
        # The last heartbeat may be older than the last request.
        if self.axis_state == AXIS_IDLE and now_ns - self._asked_ns > SETTLE_NS:
            return REST
        return STOP

    def heard(self, axis_state: int) -> bool:
        """Take the state in a heartbeat; return whether the axis left closed-loop control."""
        self.axis_state = axis_state
        if axis_state == AXIS_CLOSED_LOOP:
            self.confirmed = self._asked
            return False
        return self.confirmed

    def is_refusal(self, stamp_ns: int) -> bool:
        """Return whether a failure reported at a time [ns] is of the present request."""
        return self._asked and not self.confirmed and stamp_ns - self._asked_ns > STALE_NS
