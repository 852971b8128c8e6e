"""States and faults of our motor controller, as `MotorStatus` of robot.dbc carries them."""

from __future__ import annotations

import enum
from typing import Final

from robotctl.drivers.can.nodes.motor import DriveFault
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.drive_health import LATCHED

_LATCHED_CODES: Final = {
    DriveState.STOPPED: FaultCode.DRIVE_STOPPED,
    DriveState.EMERGENCY_STOP: FaultCode.DRIVE_EMERGENCY_STOP,
}
_FAULT_CODES: Final = {
    DriveFault.OVER_CURRENT: FaultCode.DRIVE_OVER_CURRENT,
    DriveFault.OVER_TEMPERATURE: FaultCode.DRIVE_OVER_TEMPERATURE,
    DriveFault.UNDER_VOLTAGE: FaultCode.DRIVE_UNDER_VOLTAGE,
    DriveFault.ENCODER: FaultCode.DRIVE_ENCODER,
    DriveFault.COMMAND_TIMEOUT: FaultCode.DRIVE_COMMAND_TIMEOUT,
    DriveFault.PARAMETER: FaultCode.DRIVE_PARAMETER,
}


def reported_fault(state: DriveState, faults: int, part: str) -> Fault | None:
    """Return the fault of a motor controller that has stopped or reports one, else None.

    Its code is that of the first fault bit, as in the text, except for a reported stop.

    Parameters
    ----------
    state
        State reported.
    faults
        Bits of `DriveFault`.
    part
        Name of the drive.
    """
    if not (faults or state in LATCHED):
        return None
    bits = [code for bit, code in _FAULT_CODES.items() if faults & bit]
    first = bits[0] if bits else FaultCode.DRIVE_FAULT
    words = fault_words(faults)
    if state not in LATCHED:
        return Fault(first, f"the motor controller reports{words}", part)
    code = _LATCHED_CODES.get(state, first)
    return Fault(code, f"the motor controller is in {_words(state)}{words}", part)


def fault_words(faults: int) -> str:
    """Return the motor controller's fault bits as `: over current, encoder`, or nothing."""
    names = [_words(fault) for fault in DriveFault if faults & fault]
    return f": {', '.join(names)}" if names else ""


def _words(value: enum.Enum) -> str:
    """Write an enum member for people."""
    return value.name.lower().replace("_", " ")
