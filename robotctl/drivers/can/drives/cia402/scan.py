"""Finds drives of CiA 402, and all other CANopen devices that are not ours."""

from __future__ import annotations

from typing import Any, Final

from robotctl.drivers.can.drives.cia402.wire import STATE_NAMES, STATES, STATUS_MASK
from robotctl.drivers.can.nodes.commissioning import VENDOR_ID
from robotctl.drivers.can.nodes.scan import (
    PRODUCT,
    PROFILE_402,
    STATUS_WORD,
    VENDOR,
    CanopenProbe,
    Device,
)
from robotctl.drivers.can.probe import Found

_BOTH_HALVES: Final = 4
"""Bytes of the status word of a ZLAC8015D: one word for each wheel."""

_GENERIC: Final = (
    "eds: path of its electronic data sheet; speed_unit as that or its manual says",
    "counts_per_turn: position units (6064h) in one turn of the motor",
)


def cia402_probe() -> CanopenProbe:
    """Return the probe."""
    return CanopenProbe(_describe)


def _describe(device: Device) -> Found | None:
    vendor, product = device.number(VENDOR), device.number(PRODUCT)
    if vendor == VENDOR_ID:
        return None
    name = device.name
    if not name and vendor is not None:
        name = f"vendor 0x{vendor:X}, product 0x{product or 0:X}"
    if device.profile != PROFILE_402:
        profile = device.profile
        return Found(
            "CANopen" if not profile else f"CANopen, profile {profile}",
            device.node_id,
            name=name,
            firmware=device.firmware,
            state=device.state,
        )
    dialect = _dialect(device)
    keys: dict[str, Any] = {"dialect": dialect}
    hints: tuple[str, ...] = _GENERIC if dialect == "generic" else ()
    if dialect == "generic":
        keys |= {"eds": "", "counts_per_turn": 4096}
    elif dialect == "roboteq":
        hints = _GENERIC[1:]
        keys |= {"counts_per_turn": 4096}
    return Found(
        "CiA 402",
        device.node_id,
        kind="cia402",
        name=name,
        firmware=device.firmware,
        state=_state(device),
        keys=keys,
        hints=(*hints, "ratio: turns of the motor for one of the wheel"),
        axes=1 if dialect == "generic" else 2,
    )


def _dialect(device: Device) -> str:
    name = device.name.lower()
    if "zlac" in name or len(device.values.get(STATUS_WORD) or b"") == _BOTH_HALVES:
        return "zlac8015d"
    return "roboteq" if "roboteq" in name else "generic"


def _state(device: Device) -> str:
    word = device.number(STATUS_WORD)
    words = [] if word is None else [STATE_NAMES[STATES[word & STATUS_MASK]]]
    return ", ".join([*words, device.state] if device.state else words)
