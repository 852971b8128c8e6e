"""Messages between a hub and its clients, and SocketCAN's `struct can_frame`.

Standard library only: the python-can interface imports this in programs which know nothing of the
simulator. The format is described in `python_can.py`.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable

from firmware_sim.bus.frame import MAX_DATA_LENGTH, Filter, Frame

CAN_FRAME = struct.Struct("=IBBBB8s")
"""struct can_frame: id with flags, length, flags, reserved, reserved, data (16 bytes)."""
STAMPED_FRAME = struct.Struct("=IBBBB8sQ")
"""struct can_frame and a CLOCK_MONOTONIC time in ns (24 bytes)."""
OWN = 0x01
"""Flag (byte 5) on a client's own frame, sent back to it when it was complete."""

HELLO = struct.Struct("=4sHH32s")
"""Client to hub: magic, `Options`, reserved, name of the node in UTF-8."""
HELLO_MAGIC = b"SCH1"
WELCOME = struct.Struct("=4sHHI20s")
"""Hub to client: magic, `Answer`, reserved, bitrate, name given to the node."""
WELCOME_MAGIC = b"SCW1"
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


class Answer(enum.IntEnum):
    """A hub's answer to a hello."""

    OK = 0
    REFUSED = 1


def pack_frame(frame: Frame) -> bytes:
    """Return a frame as struct can_frame."""
    arbitration_id, data, _ = frame
    return CAN_FRAME.pack(arbitration_id, len(data), 0, 0, 0, data)


def unpack_frame(message: bytes) -> tuple[int, bytes]:
    """Return (id with flags, data) of a struct can_frame, followed by anything.

    Raises
    ------
    ValueError
        If the message is too short or its data is longer than 8 bytes.
    """
    if len(message) < CAN_FRAME.size:
        raise ValueError(f"{len(message)} bytes are no struct can_frame")
    arbitration_id, length, _, _, _, data = CAN_FRAME.unpack_from(message)
    if length > MAX_DATA_LENGTH:
        raise ValueError(f"struct can_frame of {length} data bytes, at most 8")
    return arbitration_id, data[:length]


def pack_hello(name: str, options: Options) -> bytes:
    """Return a client's greeting; the name is cut to 32 bytes."""
    return HELLO.pack(HELLO_MAGIC, options, 0, name.encode()[:32])


def unpack_hello(message: bytes) -> tuple[str, Options] | None:
    """Return (name, options) of a greeting; None if it is not of this version."""
    if len(message) != HELLO.size:
        return None
    magic, options, _, name = HELLO.unpack(message)
    if magic != HELLO_MAGIC:
        return None
    return name.rstrip(b"\0").decode(errors="replace"), Options(options & 7)


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
    """Return the filters of such a message; None if invalid."""
    packed = message[len(FILTERS_MAGIC) :]
    if not message.startswith(FILTERS_MAGIC) or len(packed) % FILTER.size:
        return None
    return tuple(Filter(can_id, mask) for can_id, mask in FILTER.iter_unpack(packed))
