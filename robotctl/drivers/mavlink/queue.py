"""Bounded output of a stream: if the reader is slow, the oldest data are dropped."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

CHUNK = 4096
"""Bytes passed to one write [B]; a frame begun is always finished."""


class OutputQueue:
    """Frames waiting for a stream.

    When the limit is passed, the oldest telemetry goes first and answers last, since telemetry
    that is late is worth nothing. `dropped` counts frames.

    Parameters
    ----------
    limit : int
        Bytes that may wait beside the chunk being written [B].
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._telemetry: deque[tuple[int, bytes]] = deque()
        self._answers: deque[tuple[int, bytes]] = deque()
        self._chunk = b""
        self._size = 0
        self._number = 0
        self.dropped = 0

    def __bool__(self) -> bool:
        """Whether bytes are waiting."""
        return bool(self._chunk or self._telemetry or self._answers)

    def push(self, frame: bytes, *, answer: bool) -> None:
        """Append one frame."""
        self._number += 1
        (self._answers if answer else self._telemetry).append((self._number, frame))
        self._size += len(frame)
        while self._size > self._limit:
            _, dropped = (self._telemetry or self._answers).popleft()
            self._size -= len(dropped)
            self.dropped += 1

    def write(self, write: Callable[[bytes], int]) -> None:
        """Call `write` until nothing waits or it takes less than offered.

        Raises
        ------
        OSError
            As `write` does; BlockingIOError means that nothing was taken and only ends the call.
        """
        while self:
            self._chunk = self._chunk or self._next_chunk()
            try:
                taken = write(self._chunk)
            except BlockingIOError:
                return
            self._chunk = self._chunk[taken:]
            if self._chunk:
                return

    def _next_chunk(self) -> bytes:
        """Take frames in the order in which they came, up to the size of a chunk."""
        frames: list[bytes] = []
        size = 0
        while (self._telemetry or self._answers) and size < CHUNK:
            if not self._answers or (self._telemetry and self._telemetry[0] < self._answers[0]):
                _, frame = self._telemetry.popleft()
            else:
                _, frame = self._answers.popleft()
            frames.append(frame)
            size += len(frame)
        self._size -= size
        return b"".join(frames)
