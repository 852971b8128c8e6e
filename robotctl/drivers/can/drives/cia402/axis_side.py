"""One axis of a drive of CiA 402: its places in the process data, and its state for the robot."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.axis import Axis, Unwrapped
from robotctl.drivers.can.drives.cia402.wire import (
    FAULT,
    FAULT_REACTION,
    NOT_READY,
    OPERATION_ENABLED,
    UNKNOWN,
    Received,
    Role,
)
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import Fault, FaultCode

_STATE_OF: Final = {
    FaultCode.DRIVE_EMERGENCY_STOP: DriveState.EMERGENCY_STOP,
    FaultCode.DRIVE_STOPPED: DriveState.STOPPED,
}
"""State that a latched fault is told as; FAULT for the rest."""


class AxisSide:
    """One axis: where its values are among those received, and what is read of it by SDO.

    Parameters
    ----------
    axis
        The axis.
    number
        Its place in the process data.
    received
        Values received.
    """

    __slots__ = (
        "amps_place",
        "axis",
        "counter",
        "current_a",
        "error_place",
        "motion_pdos",
        "position_place",
        "speed_place",
        "status_pdo",
        "status_place",
        "temperature_c",
        "volts_place",
    )

    def __init__(self, axis: Axis, number: int, received: Received) -> None:
        self.axis = axis
        status = received.place(Role.STATUS, number)
        position = received.place(Role.POSITION, number)
        assert status is not None and position is not None  # noqa: S101, PT018 - of every layout
        self.status_place, self.position_place = status, position
        self.speed_place = received.place(Role.SPEED, number)
        error = received.place(Role.ERROR, number)
        self.error_place = received.place(Role.ERROR, 0) if error is None else error
        self.amps_place = received.place(Role.CURRENT, number)
        self.volts_place = received.place(Role.VOLTAGE, 0)
        self.counter = Unwrapped(32)
        self.current_a: float | None = None
        self.temperature_c: float | None = None
        pdos = (
            received.pdo_of(Role.STATUS, number),
            received.pdo_of(Role.SPEED, number),
            received.pdo_of(Role.POSITION, number),
        )
        self.status_pdo = pdos[0] or 0
        self.motion_pdos = tuple(pdo for pdo in pdos[1:] if pdo is not None)


def drive_state(state: int, fault: Fault | None) -> DriveState:
    """Return how a state of CiA 402 is told, with a latched fault."""
    if state == OPERATION_ENABLED:
        return DriveState.ENABLED
    if fault is not None:
        return _STATE_OF.get(fault.code, DriveState.FAULT)
    if state in (FAULT, FAULT_REACTION):
        return DriveState.FAULT
    return DriveState.BOOT if state in (NOT_READY, UNKNOWN) else DriveState.READY
