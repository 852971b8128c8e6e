"""Fault codes of moteus (register 0x00F, `docs/protocol/registers.md` of mjbots/moteus)."""

from __future__ import annotations

from typing import Final

from robotctl.messages.faults import Fault, FaultCode

_OTHER: Final = FaultCode.DRIVE_FAULT

_FAULTS: Final = {
    32: (FaultCode.DRIVE_ENCODER, "calibration: no magnet sensed"),
    33: (_OTHER, "motor driver: under-voltage or another electrical fault"),
    34: (FaultCode.DRIVE_OVER_VOLTAGE, "over voltage: above servo.max_voltage"),
    35: (FaultCode.DRIVE_ENCODER, "encoder: readings do not fit a magnet"),
    36: (FaultCode.DRIVE_PARAMETER, "motor not calibrated (moteus_tool --calibrate)"),
    37: (_OTHER, "PWM cycle overrun: an error of the firmware"),
    38: (FaultCode.DRIVE_OVER_TEMPERATURE, "over temperature"),
    39: (FaultCode.DRIVE_PARAMETER, "outside servopos.position_min to position_max"),
    40: (FaultCode.DRIVE_UNDER_VOLTAGE, "under voltage"),
    41: (FaultCode.DRIVE_PARAMETER, "a setting was changed that needs a stop"),
    42: (FaultCode.DRIVE_ENCODER, "no valid encoder for commutation"),
    43: (FaultCode.DRIVE_ENCODER, "no valid encoder for the position"),
    44: (_OTHER, "the gate driver could not be enabled"),
    45: (FaultCode.DRIVE_PARAMETER, "stop position with limits, which is deprecated"),
    46: (_OTHER, "timing violated: an error of the firmware"),
    47: (FaultCode.DRIVE_PARAMETER, "servo.bemf_feedforward without a limit of acceleration"),
    48: (FaultCode.DRIVE_PARAMETER, "servopos.position_min or position_max out of range"),
}


def reported_fault(code: int, part: str) -> Fault:
    """Return the fault for a drive's own code; `part` is the name of the drive."""
    kind, words = _FAULTS.get(code, (_OTHER, "not known to robotctl"))
    return Fault(kind, f"the moteus reports fault {code}: {words}", part)
