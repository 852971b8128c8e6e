"""A second socket on the robot's CAN bus, for who watches it over MAVLink."""

from __future__ import annotations

import can

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.descriptor import FD_FRAME, FRAME, Descriptor, opener
from robotctl.drivers.can.errors import CAN_ERR_FLAG
from robotctl.drivers.can.port import DRAIN_LIMIT
from robotctl.messages.ports import FD_FLAG, REMOTE_FLAG

_NO_DATA = CAN_ERR_FLAG | REMOTE_FLAG


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
        """Return identifiers and data of the data frames that came since the last call.

        The identifiers have the flags of `Frame` for 29 bits and CAN FD.
        """
        frames: list[tuple[int, bytes]] = []
        for _ in range(DRAIN_LIMIT):
            if self._descriptor is None:
                break
            try:
                raw = self._descriptor.socket.recv(FD_FRAME.size)
            except BlockingIOError:
                break
            except OSError:
                raw = b""
            if len(raw) < FRAME.size:
                self.close()
                break
            if len(raw) == FD_FRAME.size:
                number, length, _, data = FD_FRAME.unpack(raw)
                frames.append((number | FD_FLAG, data[:length]))
                continue
            number, length, data = FRAME.unpack_from(raw)
            if not number & _NO_DATA:
                frames.append((number, data[:length]))
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
