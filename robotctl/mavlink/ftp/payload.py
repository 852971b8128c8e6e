"""The payload of FILE_TRANSFER_PROTOCOL, as requests and replies carry it."""

from __future__ import annotations

import enum
import struct
from typing import Final, NamedTuple

_HEADER: Final = struct.Struct("<HBBBBBxI")
MOST_BYTES: Final = 239
"""Maximum data of one payload [B]."""
_PAYLOAD_BYTES: Final = _HEADER.size + MOST_BYTES


class Opcode(enum.IntEnum):
    """Requests, and the two kinds of replies."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(enum.IntEnum):
    """Why something cannot be done."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class FtpRefused(Exception):  # noqa: N818 - is answered, no defect
    """A request cannot be carried out."""

    def __init__(self, error: FtpError, errno: int = 0) -> None:
        super().__init__(error.name)
        self.error = error
        self.errno = errno


class FtpPayload(NamedTuple):
    """A request, or a reply, whose number is that of the request plus one."""

    seq: int
    session: int
    opcode: int
    data: bytes = b""
    offset: int = 0
    size: int = 0
    """Bytes that a read asks for; else those of the data."""
    req_opcode: int = 0
    burst_complete: int = 0

    def pack(self) -> bytes:
        """Return the payload."""
        head = _HEADER.pack(
            self.seq & 0xFFFF,
            self.session,
            self.opcode,
            len(self.data) or self.size,
            self.req_opcode,
            self.burst_complete,
            self.offset,
        )
        return (head + self.data).ljust(_PAYLOAD_BYTES, b"\0")


def unpack(payload: bytes) -> FtpPayload:
    """Return a payload; `size` is what it says, even if that is more than there is room for."""
    seq, session, opcode, size, req_opcode, burst, offset = _HEADER.unpack_from(payload)
    data = payload[_HEADER.size : _HEADER.size + size]
    return FtpPayload(seq, session, opcode, data, offset, size, req_opcode, burst)
