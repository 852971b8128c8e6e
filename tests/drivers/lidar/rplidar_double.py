"""The other end of an RPLIDAR's line: a pseudo terminal that answers as the maker's manual says."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty

INFO = bytes((0x18, 0x1D, 0x01, 0x07)) + bytes(range(16))
"""An A1: model 0x18, firmware 1.29, hardware 7."""

NODES = 360


def node(begins: bool, angle_deg: float, range_m: float, quality: int = 15) -> bytes:
    """Return one sample, by the table of the manual."""
    angle, distance = round(angle_deg * 64), round(range_m * 4000)
    return bytes(
        (
            quality << 2 | (0b01 if begins else 0b10),
            (angle << 1 & 0xFF) | 1,
            angle >> 7 & 0xFF,
            distance & 0xFF,
            distance >> 8,
        )
    )


def revolution(ranges_m, offset_deg: float = 0.0) -> bytes:
    """Return a full turn, clockwise in even steps."""
    step = 360.0 / len(ranges_m)
    return b"".join(
        node(k == 0, (offset_deg + k * step) % 360.0, range_m) for k, range_m in enumerate(ranges_m)
    )


class RplidarDouble:
    """Answers requests in a thread; `stream` is what a scan sends, once, when it begins."""

    def __init__(self, stream: bytes = b"", health: bytes = b"\x00\x00\x00", mute: bool = False):
        self.stream = stream
        self.health = [health]
        self.mute = mute
        self.asked: list[bytes] = []
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        self._slave = slave
        self._end_read, self._end_write = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Send more."""
        os.write(self._master, data)

    def close(self) -> None:
        """End."""
        os.write(self._end_write, b"x")
        self._thread.join()
        for each in (self._master, self._slave, self._end_read, self._end_write):
            os.close(each)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _serve(self) -> None:
        waiting = b""
        while True:
            ready, _, _ = select.select([self._master, self._end_read], [], [])
            if self._end_read in ready:
                return
            waiting += os.read(self._master, 4096)
            while (request := self._next(waiting)) is not None:
                waiting = waiting[len(request) :]
                self.asked.append(request)
                if not self.mute:
                    self._answer(request)

    @staticmethod
    def _next(data: bytes) -> bytes | None:
        if len(data) < 2:
            return None
        if not data[1] & 0x80:
            return data[:2]
        if len(data) < 3 or len(data) < 4 + data[2]:
            return None
        return data[: 4 + data[2]]

    def _answer(self, request: bytes) -> None:
        match request[1]:
            case 0x50:
                self.send(b"\xa5\x5a\x14\x00\x00\x00\x04" + INFO)
            case 0x52:
                health = self.health[0] if len(self.health) == 1 else self.health.pop(0)
                self.send(b"\xa5\x5a\x03\x00\x00\x00\x06" + health)
            case 0x20:
                self.send(b"\xa5\x5a\x05\x00\x00\x40\x81" + self.stream)
