"""State machine of the motor controller: when the motors may turn, and what latches.

Stops latch: `STOPPED`, `FAULT` and `EMERGENCY_STOP` are left only by `CLEAR` or `POWER_UP`, never
by a command and never by a warm (NMT) reset. After any of them, and after the node has left
operational while enabled, the host must have shown Enable=0 once before Enable=1 is taken.
"""

from __future__ import annotations

import enum


class DriveState(enum.IntEnum):
    """MotorStatus.State of robot.dbc."""

    BOOT = 0
    READY = 1
    ENABLED = 2
    STOPPED = 3
    FAULT = 4
    EMERGENCY_STOP = 5


LATCHED = frozenset({DriveState.STOPPED, DriveState.FAULT, DriveState.EMERGENCY_STOP})


class DriveEvent(enum.Enum):
    """Events of the drive."""

    POWER_UP = "power_up"
    WARM_RESET = "warm_reset"
    OPERATIONAL = "operational"
    LEFT_OPERATIONAL = "left_operational"
    ENABLE = "enable"
    DISABLE = "disable"
    TIMEOUT = "timeout"
    FAULT = "fault"
    EMERGENCY_STOP = "emergency_stop"
    CLEAR = "clear"


_S, _E = DriveState, DriveEvent

TRANSITIONS: dict[DriveState, dict[DriveEvent, DriveState]] = {
    _S.BOOT: {
        _E.OPERATIONAL: _S.READY,
        _E.FAULT: _S.FAULT,
        _E.EMERGENCY_STOP: _S.EMERGENCY_STOP,
    },
    _S.READY: {
        _E.WARM_RESET: _S.BOOT,
        _E.ENABLE: _S.ENABLED,
        _E.FAULT: _S.FAULT,
        _E.EMERGENCY_STOP: _S.EMERGENCY_STOP,
    },
    _S.ENABLED: {
        _E.WARM_RESET: _S.BOOT,
        _E.LEFT_OPERATIONAL: _S.READY,
        _E.DISABLE: _S.READY,
        _E.TIMEOUT: _S.STOPPED,
        _E.FAULT: _S.FAULT,
        _E.EMERGENCY_STOP: _S.EMERGENCY_STOP,
    },
    _S.STOPPED: {
        _E.CLEAR: _S.READY,
        _E.FAULT: _S.FAULT,
        _E.EMERGENCY_STOP: _S.EMERGENCY_STOP,
    },
    _S.FAULT: {
        _E.CLEAR: _S.READY,
        _E.EMERGENCY_STOP: _S.EMERGENCY_STOP,
    },
    _S.EMERGENCY_STOP: {
        _E.CLEAR: _S.READY,
    },
}
"""Every change of state except `POWER_UP`, which leads to BOOT from anywhere. Unlisted pairs change
nothing: an emergency stop outranks a fault, and commands do not count while latched."""


class DriveStateMachine:
    """The present state and whether Enable=0 must be seen first (`locked`)."""

    __slots__ = ("locked", "state")

    def __init__(self) -> None:
        self.state = DriveState.BOOT
        self.locked = False

    def handle(self, event: DriveEvent) -> bool:
        """Take one event; return whether the state has changed."""
        before = self.state
        if event is DriveEvent.POWER_UP:
            self.state, self.locked = DriveState.BOOT, False
            return before is not self.state
        if event is DriveEvent.DISABLE:
            self.locked = False
        elif event is DriveEvent.ENABLE and self.locked:
            return False
        after = TRANSITIONS[before].get(event, before)
        if before in LATCHED or (before is DriveState.ENABLED and event in _UNASKED):
            self.locked = self.locked or after is not before
        self.state = after
        return after is not before


_UNASKED = frozenset({DriveEvent.WARM_RESET, DriveEvent.LEFT_OPERATIONAL})
"""Ends of driving that the host did not command and that do not latch."""
