"""SDO client that never waits: one expedited transfer at a time, advanced by the control loop.

Source: CiA 301, 7.2.4 (expedited SDO upload and download, abort).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

TIMEOUT_NS: Final = 50_000_000
"""Time that a server has for its answer [ns]."""

RETRIES: Final = 3
"""How often an unanswered request is repeated."""

ABORT_NO_OBJECT: Final = 0x06020000
"""Abort code: the object does not exist (CiA 301, table 22)."""

_HEADER = struct.Struct("<BHB")
_UPLOAD_REQUEST = 0x40
_DOWNLOAD_RESPONSE = 0x60
_ABORT = 0x80
_EXPEDITED, _SIZED = 0x02, 0x01


@dataclass(frozen=True, slots=True)
class Request:
    """One transfer: reads an object, or writes `value` in `size` bytes (1 to 4) into it.

    `name` is what people call the object.
    """

    index: int
    subindex: int
    name: str
    value: int | None = None
    size: int = 0

    def frame(self) -> bytes:
        """Return the eight bytes of the request."""
        if self.value is None:
            return _HEADER.pack(_UPLOAD_REQUEST, self.index, self.subindex) + bytes(4)
        command = 0x20 | (4 - self.size) << 2 | _EXPEDITED | _SIZED
        return _HEADER.pack(command, self.index, self.subindex) + self.value.to_bytes(4, "little")

    def __str__(self) -> str:
        verb = "read" if self.value is None else "write"
        return f"{verb} of 0x{self.index:04X}:{self.subindex:02X} ({self.name})"


@dataclass(frozen=True, slots=True)
class SdoResponse:
    """How a transfer ended: `value` (0 after a write), or `abort` code, or neither: no answer."""

    value: int | None = None
    abort: int | None = None


class SdoClient:
    """Client side of one node's SDO channel. Transfers are started only when `idle`.

    Parameters
    ----------
    pause_ns
        Least time from one request to the next [ns]: some servers lose what comes sooner.
    """

    def __init__(self, pause_ns: int = 0) -> None:
        self._pause_ns = pause_ns
        self._free_ns = 0
        """When the next request may be sent [ns]."""
        self._request: Request | None = None
        self._sent_ns: int | None = None
        self._attempts = 0

    @property
    def idle(self) -> bool:
        """Whether no transfer is under way."""
        return self._request is None

    def start(self, request: Request) -> None:
        """Begin a transfer; its frame goes out with the next `poll`."""
        self._request = request
        self._sent_ns = None
        self._attempts = 0

    def cancel(self) -> None:
        """Forget the transfer; a late answer will be ignored."""
        self._request = None

    def poll(self, now_ns: int) -> bytes | None:
        """Return the frame to send now, if any. It counts as sent once `sent` is called."""
        if self._request is None or (
            self._sent_ns is not None and now_ns - self._sent_ns < TIMEOUT_NS
        ):
            return None
        if now_ns < self._free_ns:
            return None
        return self._request.frame()

    def expired(self, now_ns: int) -> bool:
        """Return whether the last retry has gone unanswered; if so, the transfer is over."""
        if (
            self._request is None
            or self._sent_ns is None
            or self._attempts <= RETRIES
            or now_ns - self._sent_ns < TIMEOUT_NS
        ):
            return False
        self._request = None
        return True

    def sent(self, now_ns: int) -> None:
        """Note that the frame of `poll` was taken by the bus."""
        self._sent_ns = now_ns
        self._free_ns = now_ns + self._pause_ns
        self._attempts += 1

    def receive(self, data: bytes) -> SdoResponse | None:
        """Take a frame of the server; return the end of the transfer, or None if it is not it."""
        request = self._request
        if request is None or self._sent_ns is None or len(data) != 8:
            return None
        command, index, subindex = _HEADER.unpack_from(data)
        if (index, subindex) != (request.index, request.subindex):
            return None
        response = None
        if command == _ABORT:
            response = SdoResponse(abort=int.from_bytes(data[4:], "little"))
        elif request.value is not None:
            response = SdoResponse(value=0) if command == _DOWNLOAD_RESPONSE else None
        elif command & 0xE2 == _UPLOAD_REQUEST | _EXPEDITED:
            size = 4 - (command >> 2 & 3) if command & _SIZED else 4
            response = SdoResponse(value=int.from_bytes(data[4 : 4 + size], "little"))
        if response is not None:
            self._request = None
        return response
