"""Error frames of SocketCAN, decoded: the host's CAN controller's report on itself and the wire.

Source: Linux, include/uapi/linux/can/error.h.
"""

from __future__ import annotations

import enum
from typing import Final

from robotctl.messages.control import BusState

CAN_ERR_FLAG: Final = 0x20000000
"""Bit of the identifier that makes an error frame."""


class ErrorClass(enum.IntEnum):
    """Bits of an error frame's identifier about the controller (CAN_ERR_*)."""

    CRTL = 0x004
    BUSOFF = 0x040
    RESTARTED = 0x100
    CNT = 0x200


class ControllerError(enum.IntEnum):
    """Bits of its second byte, of receiver and transmitter (CAN_ERR_CRTL_*)."""

    WARNING = 0x04 | 0x08
    PASSIVE = 0x10 | 0x20
    ACTIVE = 0x40


_WARNING_LEVEL, _PASSIVE_LEVEL = 96, 128


def bus_state(error_class: int, data: bytes, before: BusState) -> BusState:
    """Return the controller's state after an error frame.

    Parameters
    ----------
    error_class
        The frame's identifier without its flags: the CAN_ERR_* bits.
    data
        Its eight bytes.
    before
        State until now; an error frame without state information leaves it.
    """
    if error_class & ErrorClass.BUSOFF:
        return BusState.BUS_OFF
    if error_class & ErrorClass.RESTARTED:
        return BusState.ERROR_ACTIVE
    if error_class & ErrorClass.CRTL:
        said = data[1]
        if said & ControllerError.PASSIVE:
            return BusState.ERROR_PASSIVE
        if said & ControllerError.WARNING:
            return BusState.ERROR_WARNING
        if said & ControllerError.ACTIVE:
            return BusState.ERROR_ACTIVE
    if error_class & ErrorClass.CNT and before != BusState.BUS_OFF:
        return _state_of_counters(max(data[6], data[7]))
    return before


def _state_of_counters(highest: int) -> BusState:
    """Return the state that goes with the higher of both error counters (ISO 11898-1)."""
    if highest >= _PASSIVE_LEVEL:
        return BusState.ERROR_PASSIVE
    if highest >= _WARNING_LEVEL:
        return BusState.ERROR_WARNING
    return BusState.ERROR_ACTIVE
