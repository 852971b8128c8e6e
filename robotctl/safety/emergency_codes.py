"""EMCY codes in words: CiA 301, table 26; CiA 402-2, table 2; and the robot's own."""

from __future__ import annotations

from typing import Final

_CODES: Final = {
    0x2310: "over current",
    0x2320: "short circuit at the output",
    0x3210: "over voltage",
    0x3220: "under voltage",
    0x4210: "over temperature of the device",
    0x4310: "over temperature",
    0x5530: "non-volatile memory",
    0x6310: "stored parameters are lost",
    0x7305: "encoder",
    0x8110: "CAN overrun, messages were lost",
    0x8120: "CAN error passive",
    0x8130: "command time-out, or no heartbeat",
    0x8140: "recovered from bus off",
    0x8150: "two nodes have one identifier",
    0x8210: "a PDO was too short",
    0x8220: "a PDO was too long",
    0x8250: "no PDO in time",
    0xFF01: "emergency stop",
}
_GROUPS: Final = {
    0x21: "current at the input",
    0x22: "current inside the device",
    0x23: "current at the output",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "voltage at the output",
    0x41: "ambient temperature",
    0x42: "temperature of the device",
    0x43: "temperature of the drive",
    0x61: "internal software",
    0x62: "user's software",
    0x63: "data set",
    0x81: "communication",
    0x82: "protocol",
    0xFF: "device's own error",
}
_CLASSES: Final = {
    0x1: "generic error",
    0x2: "current",
    0x3: "voltage",
    0x4: "temperature",
    0x5: "hardware",
    0x6: "software",
    0x7: "additional module",
    0x8: "monitoring",
    0x9: "external error",
    0xF: "additional functions",
}


def emergency_words(code: int) -> str:
    """Return an EMCY code (16 bits) in words, as precisely as the standards allow."""
    return (
        _CODES.get(code)
        or _GROUPS.get(code >> 8)
        or _CLASSES.get(code >> 12)
        or "a code of no standard"
    )
