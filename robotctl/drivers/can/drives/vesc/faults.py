"""Fault codes of VESC (`mc_fault_code` of vedderb/bldc, `datatypes.h`).

No status message carries one: the host asks for it.
"""

from __future__ import annotations

from typing import Final

from robotctl.messages.faults import Fault, FaultCode

_OTHER: Final = FaultCode.DRIVE_FAULT

_FAULTS: Final = (
    (FaultCode.NONE, "none"),
    (FaultCode.DRIVE_OVER_VOLTAGE, "over voltage"),
    (FaultCode.DRIVE_UNDER_VOLTAGE, "under voltage"),
    (_OTHER, "gate driver"),
    (FaultCode.DRIVE_OVER_CURRENT, "over current (absolute limit)"),
    (FaultCode.DRIVE_OVER_TEMPERATURE, "over temperature of the bridge"),
    (FaultCode.DRIVE_OVER_TEMPERATURE, "over temperature of the motor"),
    (_OTHER, "over voltage of the gate driver"),
    (_OTHER, "under voltage of the gate driver"),
    (FaultCode.DRIVE_UNDER_VOLTAGE, "under voltage of the processor"),
    (_OTHER, "restarted by its watchdog"),
    (FaultCode.DRIVE_ENCODER, "SPI of the encoder"),
    (FaultCode.DRIVE_ENCODER, "sine and cosine of the encoder too small"),
    (FaultCode.DRIVE_ENCODER, "sine and cosine of the encoder too large"),
    (FaultCode.DRIVE_PARAMETER, "flash corrupted"),
    (_OTHER, "offset of current sensor 1 too high"),
    (_OTHER, "offset of current sensor 2 too high"),
    (_OTHER, "offset of current sensor 3 too high"),
    (_OTHER, "currents of the phases unbalanced"),
    (_OTHER, "brake input"),
    (FaultCode.DRIVE_ENCODER, "resolver: loss of tracking"),
    (FaultCode.DRIVE_ENCODER, "resolver: degradation of signal"),
    (FaultCode.DRIVE_ENCODER, "resolver: loss of signal"),
    (FaultCode.DRIVE_PARAMETER, "app configuration corrupted"),
    (FaultCode.DRIVE_PARAMETER, "motor configuration corrupted"),
    (FaultCode.DRIVE_ENCODER, "no magnet at the encoder"),
    (FaultCode.DRIVE_ENCODER, "magnet at the encoder too strong"),
    (_OTHER, "phase filter"),
    (FaultCode.DRIVE_ENCODER, "encoder"),
    (_OTHER, "low-voltage output"),
)
"""Codes and words, in the order of the drive's own codes."""


def reported_fault(code: int, part: str) -> Fault:
    """Return the fault for a drive's own code, not 0; `part` is the name of the drive."""
    kind, words = _FAULTS[code] if code < len(_FAULTS) else (_OTHER, "not known to robotctl")
    return Fault(kind, f"the VESC reports fault {code}: {words}", part)
