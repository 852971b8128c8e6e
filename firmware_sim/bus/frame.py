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
STANDARD_MASK = 0x0000_07FF
EXTENDED_MASK = 0x1FFF_FFFF
MAX_DATA_LENGTH = 8


class Frame(NamedTuple):
    """A received frame.

    Attributes
    ----------
    arbitration_id
        11-bit id, or 29-bit id with `EXTENDED_FLAG`; with `REMOTE_FLAG` for a remote request and
        with `ERROR_FLAG` for an error message (`errors.py`).
    data
        0 to 8 bytes. Of a remote request only the length counts.
    stamp_ns
        Time of the bus (ns) at which the frame was complete: the last bit of its end of frame.
    """

    arbitration_id: int
    data: bytes
    stamp_ns: int


class Filter(NamedTuple):
    """Acceptance filter as SocketCAN's: passes where `id & mask == can_id & mask`.

    Both have the flag bits at the top, so that `mask` decides whether standard and extended ids
    are told apart.
    """

    can_id: int
    mask: int

    def passes(self, arbitration_id: int) -> bool:
        """Return whether a frame of this id (with flags) is accepted."""
        return (arbitration_id ^ self.can_id) & self.mask == 0


def exact_filters(accept: Iterable[int | Filter]) -> tuple[Filter, ...]:
    """Turn plain ids, which accept just themselves, into filters; leave filters as they are."""
    return tuple(
        entry if isinstance(entry, Filter) else Filter(entry, 0xFFFF_FFFF) for entry in accept
    )


def check_id(arbitration_id: int) -> None:
    """Raise ValueError unless the id can be sent: 11 bits, or 29 with the flag, no error flag."""
    plain = arbitration_id & ~(EXTENDED_FLAG | REMOTE_FLAG)
    largest = EXTENDED_MASK if arbitration_id & EXTENDED_FLAG else STANDARD_MASK
    if not 0 <= plain <= largest:
        text = "error messages cannot be sent" if plain & ERROR_FLAG else f"allowed: 0..{largest:X}"
        raise ValueError(f"arbitration id {arbitration_id:X}: {text} (29 bits need EXTENDED_FLAG)")
