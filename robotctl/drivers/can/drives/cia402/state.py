"""The state machine of CiA 402-2 as the host drives it: one control word for all axes of a drive.

The axis that is farthest from power decides: wheels get it together or not at all.
"""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.cia402.wire import (
    FAULT,
    FAULT_REACTION,
    OPERATION_ENABLED,
    STATE_NAMES,
    UNKNOWN,
)
from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import Fault, FaultCode

DISABLE_VOLTAGE: Final = 0x00
QUICK_STOP_WORD: Final = 0x02
FAULT_RESET: Final = 0x80
ENABLE_OPERATION: Final = 0x0F
RAMP_BITS: Final = 0x70
"""In velocity mode: the ramp runs, is not held, and follows the target (CiA 402-2, 8.4)."""

_RESET_TICKS: Final = 64
"""Ticks for which a fault reset is tried: the drive may have to come to rest first."""
_RESET_PERIOD: Final = 8
"""Ticks from one rising edge of the reset bit to the next: a frame of one may be lost."""

_DEAF_SHARE: Final = 5
"""Divisor of the time of a quick stop: a drive still enabled after that part does not hear the
host."""

FASTER_RAD_S: Final = 1.0
"""Gain in speed since a quick stop began that shows that a wheel is not being stopped [rad/s]: a
loop with a wrong encoder accelerates."""

_UNEXPLAINED: Final = frozenset({FaultCode.DRIVE_STOPPED, FaultCode.DRIVE_FAULT})
"""Faults that name no cause."""


class PowerSwitch:
    """Decides on the control word, and latches what took the power.

    Parameters
    ----------
    name
        Name of the drive, the `part` of its faults.
    run_bits
        Bits of the control word beside `ENABLE_OPERATION` in operation enabled.
    stop_ticks
        Ticks that a quick stop may take; then the power is taken whatever the drive still does.

    Attributes
    ----------
    interlock
        Latches.
    lowest
        State of the axis that is farthest from power.
    must_rest
        Whether by now no axis may be enabled any more: true again and again as long as the control
        word gives no power.
    """

    __slots__ = (
        "_clear_ticks",
        "_off_rad_s",
        "_off_ticks",
        "_on_words",
        "_stop_ticks",
        "_wants",
        "_was_on",
        "interlock",
        "lowest",
        "must_rest",
    )

    def __init__(self, name: str, run_bits: int, stop_ticks: int) -> None:
        self.interlock = Interlock(name)
        self.lowest = UNKNOWN
        self.must_rest = False
        enabled = ENABLE_OPERATION | run_bits
        # By state: from quick stop, and as long as it is not ready, without voltage.
        self._on_words = (0x00, 0x00, 0x00, 0x00, 0x06, 0x07, enabled, enabled, 0x00)
        self._stop_ticks = stop_ticks
        self._clear_ticks = 0
        self._off_ticks = 0
        self._off_rad_s = 0.0
        self._wants = False
        self._was_on = False

    def observe(self, lowest: int) -> None:
        """Take the state of the axis that is farthest from power, as just received."""
        self.lowest = lowest
        if self._clear_ticks and lowest > FAULT_REACTION:
            self._clear_ticks = 0
            self.interlock.clear()
        if self._wants and self._was_on and lowest < OPERATION_ENABLED:
            text = f"the drive left operation enabled by itself, is in {STATE_NAMES[lowest]}"
            self.interlock.hold(DriveState.STOPPED, FaultCode.DRIVE_STOPPED, text)
        self._was_on = self._wants and lowest == OPERATION_ENABLED

    def latch(self, fault: Fault) -> None:
        """Latch a fault that the drive reports; the first that has a cause stays."""
        known = self.interlock.fault
        if known is None or known.code in _UNEXPLAINED:
            self.interlock.explain(fault)
        self.interlock.withhold()

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Take the power until `clear`."""
        self.interlock.stop(source)
        self._clear_ticks = 0

    def clear(self) -> None:
        """Leave latched states, if the drive does within `_RESET_TICKS`."""
        self._clear_ticks = _RESET_TICKS
        if self.lowest > FAULT_REACTION:
            self._clear_ticks = 0
            self.interlock.clear()

    def refuse(self) -> None:
        """Give no power until a command that wants none has come; that is no fault of the drive."""
        self.interlock.withhold()
        self._wants = self._was_on = False

    def wants(self, enable: bool, in_service: bool) -> bool:
        """Return whether the drive is to have power in this tick.

        Parameters
        ----------
        enable
            What the command says.
        in_service
            Whether the drive is commissioned and there.
        """
        self._wants = self.interlock.admits(enable, in_service)
        return self._wants

    def word(self, brake: bool, speed_rad_s: float = 0.0) -> int:
        """Return the control word of this tick, after `wants`.

        Parameters
        ----------
        brake
            What the command says.
        speed_rad_s
            Speed of the fastest wheel [rad/s].
        """
        self.must_rest = False
        if self._wants:
            self._off_ticks = 0
            return self._on_words[self.lowest]
        if self._clear_ticks:
            self._clear_ticks -= 1
            if self.lowest == FAULT and self._clear_ticks % _RESET_PERIOD < _RESET_PERIOD // 2:
                return FAULT_RESET
            return DISABLE_VOLTAGE
        self._off_ticks += 1
        if self._off_ticks == 1:
            self._off_rad_s = speed_rad_s
        self.must_rest = self._off_ticks % (self._stop_ticks // _DEAF_SHARE) == 0
        if speed_rad_s > self._off_rad_s + FASTER_RAD_S:
            self._off_ticks += self._stop_ticks
        if brake and self._off_ticks <= self._stop_ticks:
            return QUICK_STOP_WORD
        return DISABLE_VOLTAGE
