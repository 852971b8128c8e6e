"""One CAN frame as every part of simcan passes it on, with SocketCAN's flag bits in its id.

This module needs the standard library only: the python-can interface imports it in programs
which know nothing of the simulator.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

EXTENDED_FLAG = 0x8000_0000
"""The id has 29 bits (CAN_EFF_FLAG of linux/can.h)."""
REMOTE_FLAG = 0x4000_0000
"""Remote transmission request (CAN_RTR_FLAG)."""
ERROR_FLAG = 0x2000_0000
"""An error message of a controller, not a frame of the bus (CAN_ERR_FLAG)."""
FD_FLAG = 1 << 32
"""A frame of CAN FD. Beyond SocketCAN's 32 bits, so that no id of a classic frame equals it."""
BIT_RATE_SWITCH_FLAG = 1 << 33
"""Its data phase has the data bit rate (BRS)."""
ERROR_STATE_FLAG = 1 << 34
"""Its transmitter is error-passive (ESI)."""
FD_FLAGS_SHIFT = 33
"""Shift of SocketCAN's flags in struct canfd_frame to these two."""
STANDARD_MASK = 0x0000_07FF
EXTENDED_MASK = 0x1FFF_FFFF
CLASSIC_MAX = 0xFFFF_FFFF
"""Greatest id, flags included, of a frame that is not CAN FD."""
MAX_DATA_LENGTH = 8
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data lengths of CAN FD, by data length code."""

EXACT_MASK = FD_FLAG | 0xFFFF_FFFF
"""Mask of the id and flags that do not vary between frames of CAN FD with one id."""
_FD_FLAGS = FD_FLAG | BIT_RATE_SWITCH_FLAG | ERROR_STATE_FLAG


class Frame(NamedTuple):
    """A received frame.

    Attributes
    ----------
    arbitration_id
        11-bit id, or 29-bit id with `EXTENDED_FLAG`; with `REMOTE_FLAG` for a remote request, with
        `FD_FLAG` and possibly `BIT_RATE_SWITCH_FLAG` and `ERROR_STATE_FLAG` for CAN FD, and with
        `ERROR_FLAG` for an error message (`errors.py`).
    data
        0 to 8 bytes, in CAN FD one of `FD_LENGTHS`. Only the length of a remote request counts.
    stamp_ns
        Time of the bus (ns) at which the frame was complete: the last bit of its end of frame.
    """

    arbitration_id: int
    data: bytes
    stamp_ns: int


class Filter(NamedTuple):
    """Acceptance filter as SocketCAN's: passes where `id & mask == can_id & mask`.

    Both have the flag bits at the top, so that `mask` decides whether standard and extended ids,
    and classic and FD frames, are distinguished.
    """

    can_id: int
    mask: int

    def passes(self, arbitration_id: int) -> bool:
        """Return whether a frame of this id (with flags) is accepted."""
        return (arbitration_id ^ self.can_id) & self.mask == 0


def exact_filters(accept: Iterable[int | Filter]) -> tuple[Filter, ...]:
    """Turn plain ids into filters that accept exactly these; leave filters unchanged.

    An id with `FD_FLAG` accepts frames with and without bit-rate switch.
    """
    return tuple(
        entry if isinstance(entry, Filter) else Filter(entry & EXACT_MASK, EXACT_MASK)
        for entry in accept
    )


def check_frame(arbitration_id: int, length: int) -> None:
    """Check that a frame of this id, with flags, and data length can be sent.

    Raises
    ------
    ValueError
        If the id has more than 11 bits, or 29 with `EXTENDED_FLAG`, an error flag, or flags that
        exclude each other; or there is no frame of this length.
    """
    plain = arbitration_id & ~(EXTENDED_FLAG | REMOTE_FLAG | _FD_FLAGS)
    largest = EXTENDED_MASK if arbitration_id & EXTENDED_FLAG else STANDARD_MASK
    is_fd = bool(arbitration_id & FD_FLAG)
    if not 0 <= plain <= largest:
        text = "error messages cannot be sent" if plain & ERROR_FLAG else f"allowed: 0..{largest:X}"
        raise ValueError(f"arbitration id {arbitration_id:X}: {text} (29 bits need EXTENDED_FLAG)")
    if is_fd and arbitration_id & REMOTE_FLAG:
        raise ValueError(f"frame {arbitration_id:X}: CAN FD has no remote requests")
    if arbitration_id > CLASSIC_MAX and not is_fd:
        raise ValueError(f"frame {arbitration_id:X}: BRS and ESI need FD_FLAG")
    if is_fd and length not in FD_LENGTHS:
        lengths = ", ".join(map(str, FD_LENGTHS[9:]))
        raise ValueError(f"frame {plain:X}: {length} data bytes, allowed: 0 to 8, {lengths}")
    if not is_fd and length > MAX_DATA_LENGTH:
        raise ValueError(f"frame {plain:X}: {length} data bytes, at most 8 without FD_FLAG")
