"""Error codes of drives, as our fault codes and in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from robotctl.messages.faults import FaultCode


class Meaning(NamedTuple):
    """Meaning of an error code."""

    code: FaultCode
    words: str


Decode: TypeAlias = Callable[[int], Meaning]
"""Returns the meaning of a drive's error code, which is not 0."""

HEARTBEAT_LOST: Final = 0x8130
"""Error code of a lost heartbeat (CiA 301, 7.2.7.1)."""

_CODES: Final = {
    0x2310: Meaning(FaultCode.DRIVE_OVER_CURRENT, "continuous over-current"),
    0x2320: Meaning(FaultCode.DRIVE_OVER_CURRENT, "short circuit or earth leakage"),
    0x3210: Meaning(FaultCode.DRIVE_OVER_VOLTAGE, "DC link over-voltage"),
    0x3220: Meaning(FaultCode.DRIVE_UNDER_VOLTAGE, "DC link under-voltage"),
    0x4210: Meaning(FaultCode.DRIVE_OVER_TEMPERATURE, "over-temperature of the device"),
    0x4310: Meaning(FaultCode.DRIVE_OVER_TEMPERATURE, "over-temperature of the drive"),
    0x5530: Meaning(FaultCode.DRIVE_PARAMETER, "non-volatile memory"),
    0x6320: Meaning(FaultCode.DRIVE_PARAMETER, "parameter error"),
    0x7121: Meaning(FaultCode.DRIVE_FAULT, "motor blocked"),
    0x7305: Meaning(FaultCode.DRIVE_ENCODER, "incremental sensor 1"),
    0x7306: Meaning(FaultCode.DRIVE_ENCODER, "incremental sensor 2"),
    0x8110: Meaning(FaultCode.DRIVE_FAULT, "CAN overrun"),
    0x8120: Meaning(FaultCode.DRIVE_FAULT, "CAN error passive"),
    HEARTBEAT_LOST: Meaning(FaultCode.DRIVE_COMMAND_TIMEOUT, "heartbeat of the host lost"),
    0x8140: Meaning(FaultCode.DRIVE_FAULT, "recovered from bus-off"),
    0x8400: Meaning(FaultCode.DRIVE_FAULT, "speed controller"),
    0x8611: Meaning(FaultCode.DRIVE_FAULT, "following error"),
}
_CLASSES: Final = (
    (0xF000, 0x2000, Meaning(FaultCode.DRIVE_OVER_CURRENT, "current")),
    (0xFFF0, 0x3210, Meaning(FaultCode.DRIVE_OVER_VOLTAGE, "DC link over-voltage")),
    (0xFFF0, 0x3220, Meaning(FaultCode.DRIVE_UNDER_VOLTAGE, "DC link under-voltage")),
    (0xFFF0, 0x3110, Meaning(FaultCode.DRIVE_OVER_VOLTAGE, "mains over-voltage")),
    (0xFFF0, 0x3120, Meaning(FaultCode.DRIVE_UNDER_VOLTAGE, "mains under-voltage")),
    (0xF000, 0x4000, Meaning(FaultCode.DRIVE_OVER_TEMPERATURE, "temperature")),
    (0xFF00, 0x6300, Meaning(FaultCode.DRIVE_PARAMETER, "data set")),
    (0xFF00, 0x7300, Meaning(FaultCode.DRIVE_ENCODER, "sensor")),
    (0xFF00, 0x8100, Meaning(FaultCode.DRIVE_FAULT, "communication")),
)
"""Mask and value of classes of codes, for those that are not in `_CODES`."""


def of_cia402(code: int) -> Meaning:
    """Return the meaning of a code of CiA 402-2, annex A (IEC 61800-7-201)."""
    if (known := _CODES.get(code)) is not None:
        return Meaning(known.code, f"{known.words} (0x{code:04X})")
    for mask, value, meaning in _CLASSES:
        if code & mask == value:
            return Meaning(meaning.code, f"{meaning.words} (0x{code:04X})")
    return Meaning(FaultCode.DRIVE_FAULT, f"error 0x{code:04X}")


def by_bits(*bits: tuple[int, FaultCode, str]) -> Decode:
    """Return the decoder of codes whose bits mean one fault each; the first names the code."""

    def decode(code: int) -> Meaning:
        found = [(fault, words) for bit, fault, words in bits if code & bit]
        if not found:
            return Meaning(FaultCode.DRIVE_FAULT, f"error 0x{code:04X}")
        words = ", ".join(words for _, words in found)
        return Meaning(found[0][0], f"{words} (0x{code:04X})")

    return decode


of_zlac8015d: Final = by_bits(
    (0x0001, FaultCode.DRIVE_OVER_VOLTAGE, "over-voltage"),
    (0x0002, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage"),
    (0x0004, FaultCode.DRIVE_OVER_CURRENT, "over-current"),
    (0x0008, FaultCode.DRIVE_OVER_CURRENT, "overload"),
    (0x0010, FaultCode.DRIVE_FAULT, "current out of tolerance"),
    (0x0020, FaultCode.DRIVE_ENCODER, "encoder out of tolerance"),
    (0x0040, FaultCode.DRIVE_FAULT, "speed out of tolerance"),
    (0x0080, FaultCode.DRIVE_FAULT, "reference voltage"),
    (0x0100, FaultCode.DRIVE_PARAMETER, "EEPROM"),
    (0x0200, FaultCode.DRIVE_ENCODER, "Hall sensor"),
    (0x0400, FaultCode.DRIVE_OVER_TEMPERATURE, "motor temperature"),
)
"""Bits of 603Fh as public drivers name them (rasheeddo/ZLAC8015D_python)."""

of_roboteq: Final = by_bits(
    (0x01, FaultCode.DRIVE_OVER_TEMPERATURE, "overheat"),
    (0x02, FaultCode.DRIVE_OVER_VOLTAGE, "over-voltage"),
    (0x04, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage"),
    (0x08, FaultCode.DRIVE_OVER_CURRENT, "short circuit"),
    (0x10, FaultCode.DRIVE_EMERGENCY_STOP, "emergency stop"),
    (0x20, FaultCode.DRIVE_ENCODER, "motor or sensor set-up"),
    (0x40, FaultCode.DRIVE_FAULT, "MOSFET failure"),
    (0x80, FaultCode.DRIVE_PARAMETER, "default configuration loaded"),
)
"""Fault flags, object 2112h (query FF of the maker's user manual)."""
