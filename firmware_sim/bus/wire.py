"""Messages between a hub and its clients, and SocketCAN's `can_frame` and `canfd_frame`.

Standard library only: the python-can interface imports this in programs which know nothing of the
simulator. The format is described in `python_can.py`.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable

from firmware_sim.bus.frame import (
    CLASSIC_MAX,
    FD_FLAG,
    FD_FLAGS_SHIFT,
    MAX_DATA_LENGTH,
    Filter,
    Frame,
)

CAN_FRAME = struct.Struct("=IBBBB8s")
"""struct can_frame: id with flags, length, three reserved bytes, data (16 bytes)."""
FD_FRAME = struct.Struct("=IBBBB64s")
"""struct canfd_frame: id with flags, length, flags, two reserved bytes, data (72 bytes)."""
STAMPED_FRAME = struct.Struct("=IBBBB8sQ")
STAMPED_FD_FRAME = struct.Struct("=IBBBB64sQ")
"""The same and a CLOCK_MONOTONIC time in ns (24 and 80 bytes)."""
FRAME_SIZES = frozenset({CAN_FRAME.size, STAMPED_FRAME.size})
FD_FRAME_SIZES = frozenset({FD_FRAME.size, STAMPED_FD_FRAME.size})
OWN = 0x01
"""Flag (byte 6) on a client's own frame, sent back to it when it was complete."""

SWITCH, PASSIVE, FDF = 0x01, 0x02, 0x04
"""Flags in byte 5 of a canfd_frame: CANFD_BRS, CANFD_ESI and CANFD_FDF of linux/can.h."""

HELLO = struct.Struct("=4sHH32s")
"""Client to hub: magic, `Options`, reserved, name of the node in UTF-8."""
HELLO_MAGIC = b"SCH1"
WELCOME = struct.Struct("=4sHHII16s")
"""Hub to client: magic, `Answer`, reserved, bit rates (data bit rate 0: a classic bus), name given
to the node."""
WELCOME_MAGIC = b"SCW2"
FILTERS_MAGIC = b"SCF1"
"""Client to hub: magic, then for each filter id and mask (32 bits each)."""
FILTER = struct.Struct("=II")
MAX_FILTERS = 512
MAX_MESSAGE = len(FILTERS_MAGIC) + MAX_FILTERS * FILTER.size


class Options(enum.IntFlag):
    """A client's request."""

    RECEIVE_OWN = 1
    ERRORS = 2
    LISTEN_ONLY = 4
    FD = 8
    FD_TOLERANT = 16


class Answer(enum.IntEnum):
    """A hub's answer to a hello."""

    OK = 0
    REFUSED = 1


def pack_frame(frame: Frame) -> bytes:
    """Return a frame as struct can_frame, or canfd_frame for CAN FD."""
    arbitration_id, data, _ = frame
    if arbitration_id <= CLASSIC_MAX:
        return CAN_FRAME.pack(arbitration_id, len(data), 0, 0, 0, data)
    flags = FDF | arbitration_id >> FD_FLAGS_SHIFT
    return FD_FRAME.pack(arbitration_id & CLASSIC_MAX, len(data), flags, 0, 0, data)


def stamp_frame(frame: Frame, stamp_ns: int, own: int) -> bytes:
    """Return a frame as a hub sends it: with its time [ns] and, on request, flagged as `OWN`."""
    arbitration_id, data, _ = frame
    if arbitration_id <= CLASSIC_MAX:
        return STAMPED_FRAME.pack(arbitration_id, len(data), 0, own, 0, data, stamp_ns)
    can_id, flags = arbitration_id & CLASSIC_MAX, FDF | arbitration_id >> FD_FLAGS_SHIFT
    return STAMPED_FD_FRAME.pack(can_id, len(data), flags, own, 0, data, stamp_ns)


def unpack_frame(message: bytes) -> tuple[int, bytes]:
    """Return (id with flags, data) of a can_frame or canfd_frame, with its time or without.

    Raises
    ------
    ValueError
        If the message has another size, or states an impossible data length.
    """
    if len(message) in FRAME_SIZES:
        arbitration_id, length, _, _, _, data = CAN_FRAME.unpack_from(message)
        most = MAX_DATA_LENGTH
    elif len(message) in FD_FRAME_SIZES:
        can_id, length, flags, _, _, data = FD_FRAME.unpack_from(message)
        arbitration_id = can_id | FD_FLAG | (flags & (SWITCH | PASSIVE)) << FD_FLAGS_SHIFT
        most = len(data)
    else:
        raise ValueError(f"{len(message)} bytes are no frame")
    if length > most:
        raise ValueError(f"frame of {length} data bytes, at most {most}")
    return arbitration_id, data[:length]


def pack_hello(name: str, options: Options) -> bytes:
    """Return a client's greeting; the name is cut to 32 bytes."""
    return HELLO.pack(HELLO_MAGIC, options, 0, name.encode()[:32])


def unpack_hello(message: bytes) -> tuple[str, Options] | None:
    """Return (name, options) of a greeting; None if it has another version."""
    if len(message) != HELLO.size:
        return None
    magic, options, _, name = HELLO.unpack(message)
    if magic != HELLO_MAGIC:
        return None
    return name.rstrip(b"\0").decode(errors="replace"), Options(options & 31)


def pack_filters(filters: Iterable[Filter]) -> bytes:
    """Return the message that sets a client's acceptance filters.

    Raises
    ------
    ValueError
        If there are more than SocketCAN takes (512).
    """
    packed = b"".join(FILTER.pack(*entry) for entry in filters)
    if len(packed) > MAX_FILTERS * FILTER.size:
        raise ValueError(f"{len(packed) // FILTER.size} filters, at most {MAX_FILTERS}")
    return FILTERS_MAGIC + packed


def unpack_filters(message: bytes) -> tuple[Filter, ...] | None:
    """Return the filters of a filter message; None if invalid."""
    packed = message[len(FILTERS_MAGIC) :]
    if not message.startswith(FILTERS_MAGIC) or len(packed) % FILTER.size:
        return None
    return tuple(Filter(can_id, mask) for can_id, mask in FILTER.iter_unpack(packed))
