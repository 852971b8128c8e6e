"""A second socket on the robot's CAN bus, for who watches it over MAVLink."""

from __future__ import annotations

import can

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.port import CAN_SFF_MASK, DRAIN_LIMIT, FRAME, Descriptor, opener


class BusTap:
    """Hears and sends frames while it is open; nothing here waits or raises.

    Parameters
    ----------
    config
        Which bus.
    """

    def __init__(self, config: CanConfig) -> None:
        self._open = opener(config, ())
        self._descriptor: Descriptor | None = None

    def open(self) -> bool:
        """Open the bus, if it is not; return whether it is."""
        if self._descriptor is None:
            try:
                self._descriptor = self._open()
            except (OSError, can.CanError, ValueError):
                return False
        return True

    def receive(self) -> list[tuple[int, bytes]]:
        """Return identifiers and data of the data frames that came since the last call."""
        frames: list[tuple[int, bytes]] = []
        for _ in range(DRAIN_LIMIT):
            if self._descriptor is None:
                break
            try:
                raw = self._descriptor.socket.recv(FRAME.size)
            except BlockingIOError:
                break
            except OSError:
                raw = b""
            if len(raw) < FRAME.size:
                self.close()
                break
            number, length, data = FRAME.unpack(raw)
            if number <= CAN_SFF_MASK:  # no flag of extended, remote or error frames
                frames.append((number, data[: min(length, len(data))]))
        return frames

    def send(self, number: int, data: bytes) -> None:
        """Send one frame, if the bus takes it."""
        if self._descriptor is None:
            return
        try:
            self._descriptor.socket.send(FRAME.pack(number, len(data), data))
        except BlockingIOError:
            return
        except OSError:
            self.close()

    def close(self) -> None:
        """Release the bus."""
        if self._descriptor is not None:
            self._descriptor.close()
            self._descriptor = None
