"""Errors of an ODrive: their names, what they mean here, and what to look at.

Names and numbers: value tables of Axis_Error, Motor_Error, Encoder_Error and Controller_Error in
the DBC of firmware 0.5.6, and of Active_Errors in that of 0.6.10 (package odrive-can 2.1.0);
REQUESTED_CURRENT_TOO_HIGH from the package odrive 0.6.11.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

from robotctl.messages.faults import Fault, FaultCode

INITIALIZING: Final = 1
"""Error of 0.6 while it starts up."""


class Error(NamedTuple):
    """One error bit: its name, its kind of fault, and a hint, or nothing."""

    bit: int
    name: str
    code: FaultCode
    hint: str = ""


_F = FaultCode
_BRAKE_RESISTOR = (
    "braking feeds the supply: fit a brake resistor and set it in {where}, or allow the battery to "
    "take the current ({limit})"
)
_RESISTOR_06 = _BRAKE_RESISTOR.format(
    where="config.brake_resistor0", limit="config.dc_max_negative_current"
)
_RESISTOR_05 = _BRAKE_RESISTOR.format(
    where="config.enable_brake_resistor and config.brake_resistance",
    limit="config.dc_max_negative_current",
)
_DISARMED = "the brake resistor is off: check it and its settings, then clear the errors"
_WATCHDOG = "it had no command within its watchdog's time"
_ENCODER = "check the encoder's cable, and that it is calibrated"
_CALIBRATE = "calibrate with odrivetool, save, and let nothing start by itself"

ERRORS_06: Final = (
    Error(0x02000000, "ESTOP_REQUESTED", _F.DRIVE_EMERGENCY_STOP),
    Error(0x00000100, "DC_BUS_OVER_VOLTAGE", _F.DRIVE_OVER_VOLTAGE, _RESISTOR_06),
    Error(0x00000200, "DC_BUS_UNDER_VOLTAGE", _F.DRIVE_UNDER_VOLTAGE, "check battery and cable"),
    Error(0x00000400, "DC_BUS_OVER_CURRENT", _F.DRIVE_OVER_CURRENT),
    Error(0x00000800, "DC_BUS_OVER_REGEN_CURRENT", _F.DRIVE_OVER_VOLTAGE, _RESISTOR_06),
    Error(0x00001000, "CURRENT_LIMIT_VIOLATION", _F.DRIVE_OVER_CURRENT),
    Error(0x00002000, "MOTOR_OVER_TEMP", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x00004000, "INVERTER_OVER_TEMP", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x10000000, "THERMISTOR_DISCONNECTED", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x00000008, "MISSING_ESTIMATE", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x04000000, "SPINOUT_DETECTED", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x00000010, "BAD_CONFIG", _F.DRIVE_PARAMETER),
    Error(0x00020000, "REQUESTED_CURRENT_TOO_HIGH", _F.DRIVE_PARAMETER),
    Error(0x40000000, "CALIBRATION_ERROR", _F.DRIVE_PARAMETER, _CALIBRATE),
    Error(0x00000020, "DRV_FAULT", _F.DRIVE_FAULT),
    Error(0x00008000, "VELOCITY_LIMIT_VIOLATION", _F.DRIVE_FAULT),
    Error(0x00010000, "POSITION_LIMIT_VIOLATION", _F.DRIVE_FAULT),
    Error(0x08000000, "BRAKE_RESISTOR_DISARMED", _F.DRIVE_FAULT, _DISARMED),
    Error(0x00000004, "TIMING_ERROR", _F.DRIVE_FAULT),
    Error(0x00000040, "MISSING_INPUT", _F.DRIVE_FAULT),
    Error(0x00000002, "SYSTEM_LEVEL", _F.DRIVE_FAULT),
    Error(0x01000000, "WATCHDOG_TIMER_EXPIRED", _F.DRIVE_COMMAND_TIMEOUT, _WATCHDOG),
    Error(INITIALIZING, "INITIALIZING", _F.DRIVE_FAULT),
)
"""Errors of firmware 0.6; the first that is set gives the fault its code."""

MOTOR_05: Final = (
    Error(0x00020000, "MOTOR_THERMISTOR_OVER_TEMP", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x00040000, "FET_THERMISTOR_OVER_TEMP", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x00000400, "CURRENT_SENSE_SATURATION", _F.DRIVE_OVER_CURRENT),
    Error(0x00001000, "CURRENT_LIMIT_VIOLATION", _F.DRIVE_OVER_CURRENT),
    Error(0x00400000, "I_BUS_OUT_OF_RANGE", _F.DRIVE_OVER_CURRENT, _RESISTOR_05),
    Error(0x00000008, "DRV_FAULT", _F.DRIVE_FAULT),
    Error(0x00800000, "BRAKE_RESISTOR_DISARMED", _F.DRIVE_FAULT, _DISARMED),
    Error(
        0x01000000,
        "SYSTEM_LEVEL",
        _F.DRIVE_FAULT,
        "the whole board has an error, such as too high or low a voltage, which firmware 0.5 does "
        "not tell over CAN: dump_errors(odrv0) in odrivetool does; at too high a voltage, "
        + _RESISTOR_05,
    ),
    Error(0x00000001, "PHASE_RESISTANCE_OUT_OF_RANGE", _F.DRIVE_PARAMETER, _CALIBRATE),
    Error(0x00000002, "PHASE_INDUCTANCE_OUT_OF_RANGE", _F.DRIVE_PARAMETER, _CALIBRATE),
    Error(0x800000000, "UNBALANCED_PHASES", _F.DRIVE_PARAMETER, _CALIBRATE),
    Error(0x00000010, "CONTROL_DEADLINE_MISSED", _F.DRIVE_FAULT),
    Error(0x00000080, "MODULATION_MAGNITUDE", _F.DRIVE_FAULT),
    Error(0x00010000, "MODULATION_IS_NAN", _F.DRIVE_FAULT),
    Error(0x00080000, "TIMER_UPDATE_MISSED", _F.DRIVE_FAULT),
    Error(0x00100000, "CURRENT_MEASUREMENT_UNAVAILABLE", _F.DRIVE_FAULT),
    Error(0x00200000, "CONTROLLER_FAILED", _F.DRIVE_FAULT),
    Error(0x02000000, "BAD_TIMING", _F.DRIVE_FAULT),
    Error(0x04000000, "UNKNOWN_PHASE_ESTIMATE", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x08000000, "UNKNOWN_PHASE_VEL", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x10000000, "UNKNOWN_TORQUE", _F.DRIVE_FAULT),
    Error(0x20000000, "UNKNOWN_CURRENT_COMMAND", _F.DRIVE_FAULT),
    Error(0x40000000, "UNKNOWN_CURRENT_MEASUREMENT", _F.DRIVE_FAULT),
    Error(0x80000000, "UNKNOWN_VBUS_VOLTAGE", _F.DRIVE_FAULT),
    Error(0x100000000, "UNKNOWN_VOLTAGE_COMMAND", _F.DRIVE_FAULT),
    Error(0x200000000, "UNKNOWN_GAINS", _F.DRIVE_FAULT),
    Error(0x400000000, "CONTROLLER_INITIALIZING", _F.DRIVE_FAULT),
)
ENCODER_05: Final = (
    Error(0x004, "NO_RESPONSE", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x002, "CPR_POLEPAIRS_MISMATCH", _F.DRIVE_ENCODER, "check cpr and pole_pairs"),
    Error(0x010, "ILLEGAL_HALL_STATE", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x040, "ABS_SPI_TIMEOUT", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x080, "ABS_SPI_COM_FAIL", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x100, "ABS_SPI_NOT_READY", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x020, "INDEX_NOT_FOUND_YET", _F.DRIVE_ENCODER, _CALIBRATE),
    Error(0x200, "HALL_NOT_CALIBRATED_YET", _F.DRIVE_ENCODER, _CALIBRATE),
    Error(0x008, "UNSUPPORTED_ENCODER_MODE", _F.DRIVE_PARAMETER),
    Error(0x001, "UNSTABLE_GAIN", _F.DRIVE_PARAMETER),
)
CONTROLLER_05: Final = (
    Error(0x01, "OVERSPEED", _F.DRIVE_FAULT, "faster than vel_limit times its tolerance"),
    Error(0x80, "SPINOUT_DETECTED", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x20, "INVALID_ESTIMATE", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x02, "INVALID_INPUT_MODE", _F.DRIVE_PARAMETER),
    Error(0x04, "UNSTABLE_GAIN", _F.DRIVE_PARAMETER),
    Error(0x08, "INVALID_MIRROR_AXIS", _F.DRIVE_PARAMETER),
    Error(0x10, "INVALID_LOAD_ENCODER", _F.DRIVE_PARAMETER),
    Error(0x40, "INVALID_CIRCULAR_RANGE", _F.DRIVE_PARAMETER),
)
AXIS_05: Final = (
    Error(0x04000, "ESTOP_REQUESTED", _F.DRIVE_EMERGENCY_STOP),
    Error(0x40000, "OVER_TEMP", _F.DRIVE_OVER_TEMPERATURE),
    Error(0x00100, "ENCODER_FAILED", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x80000, "UNKNOWN_POSITION", _F.DRIVE_ENCODER, _ENCODER),
    Error(0x00001, "INVALID_STATE", _F.DRIVE_PARAMETER, _CALIBRATE),
    Error(0x00040, "MOTOR_FAILED", _F.DRIVE_FAULT),
    Error(0x00080, "SENSORLESS_ESTIMATOR_FAILED", _F.DRIVE_FAULT),
    Error(0x00200, "CONTROLLER_FAILED", _F.DRIVE_FAULT),
    Error(0x01000, "MIN_ENDSTOP_PRESSED", _F.DRIVE_FAULT),
    Error(0x02000, "MAX_ENDSTOP_PRESSED", _F.DRIVE_FAULT),
    Error(0x20000, "HOMING_WITHOUT_ENDSTOP", _F.DRIVE_FAULT),
    Error(0x00800, "WATCHDOG_TIMER_EXPIRED", _F.DRIVE_COMMAND_TIMEOUT, _WATCHDOG),
)

PROCEDURE_RESULTS: Final = (
    *("SUCCESS", "BUSY", "CANCELLED", "DISARMED", "NO_RESPONSE", "POLE_PAIR_CPR_MISMATCH"),
    *("PHASE_RESISTANCE_OUT_OF_RANGE", "PHASE_INDUCTANCE_OUT_OF_RANGE", "UNBALANCED_PHASES"),
    *("INVALID_MOTOR_TYPE", "ILLEGAL_HALL_STATE", "TIMEOUT", "HOMING_WITHOUT_ENDSTOP"),
    *("INVALID_STATE", "NOT_CALIBRATED", "NOT_CONVERGING", "REQUESTED_CURRENT_TOO_HIGH"),
)
"""Results of a requested state in firmware 0.6, by number."""

FIRST_REFUSAL: Final = 4
"""First of the results that say that a requested state could not be entered."""


def refusal(result: int) -> str:
    """Say that closed-loop control was refused, for a result of firmware 0.6."""
    known = result < len(PROCEDURE_RESULTS)
    name = PROCEDURE_RESULTS[result] if known else f"result {result}, which is not known"
    return f"the ODrive refused closed-loop control: {name}"


Section: TypeAlias = tuple[str, int, tuple[Error, ...]]
"""Part of the drive, its errors, and what they mean."""


def reported_fault(sections: tuple[Section, ...], part: str) -> Fault:
    """Return the fault of the errors that are set, with what to do about the first."""
    names = []
    first: Error | None = None
    for where, errors, table in sections:
        rest = errors
        for error in table:
            if errors & error.bit:
                names.append(f"{where}{error.name}")
                rest ^= error.bit
                first = first or error
        if rest:
            names.append(f"{where}error 0x{rest:X}, which is not known")
    text = f"the ODrive reports {', '.join(names)}"
    if first is not None and first.hint:
        text += f": {first.hint}"
    return Fault(first.code if first else FaultCode.DRIVE_FAULT, text, part)
