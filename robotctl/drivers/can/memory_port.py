"""The twin of a CAN port inside one process: for lockstep under the virtual clock, and tests."""

from __future__ import annotations

from collections.abc import Callable, Collection

from robotctl.drivers.can.bus_meter import FRAME_BITS, BusMeter
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.errors import CAN_ERR_FLAG, bus_state
from robotctl.messages.control import BusStatus
from robotctl.messages.ports import Clock, Frame

_STANDARD_MAX = 0x7FF


class MemoryPort:
    """A `CanPort` joined to a bus by two functions.

    The bus calls `deliver` for what the port shall receive; the port calls `transmit` for what it
    sends.

    Parameters
    ----------
    transmit
        Takes identifier, with flags as in `Frame`, and data of a frame; returns False if the bus
        refuses it. It may be replaced, since the bus wants `deliver` first.
    arbitration_ids
        Accepted identifiers, as in the kernel's filter.
    config
        Which bus: its bit rates decide the load, and whether it carries CAN FD.
    clock
        For the load.
    """

    def __init__(
        self,
        transmit: Callable[[int, bytes], object],
        arbitration_ids: Collection[int] | None,
        config: CanConfig,
        clock: Clock,
    ) -> None:
        self.transmit = transmit
        self._clock = clock
        self._meter = BusMeter(config)
        self._wanted = self._meter.accepted(arbitration_ids)
        self._inbox: list[Frame] = []
        self._open = True

    def deliver(self, frame: tuple[int, bytes, int]) -> None:
        """Put one frame into the inbox: identifier, data and time of reception [ns].

        An identifier with CAN_ERR_FLAG is an error frame and moves the state of the bus.
        """
        arbitration_id, data, _ = frame
        bits = self._wanted.get(arbitration_id)
        if bits is not None and self._open:
            # A third of the time of Frame(...), which is a function in Python.
            self._inbox.append(tuple.__new__(Frame, frame))
            self._meter.bits += bits[len(data)]
        elif arbitration_id & CAN_ERR_FLAG:
            meter = self._meter
            meter.error_frames += 1
            meter.state = bus_state(arbitration_id & ~CAN_ERR_FLAG, data, meter.state)

    def send(self, arbitration_id: int, data: bytes) -> bool:
        """Hand one frame to the bus; False if it refuses."""
        meter = self._meter
        if arbitration_id <= _STANDARD_MAX:
            bits = FRAME_BITS[len(data)]
        else:
            bits = meter.measure(arbitration_id, len(data))
        if not bits or not self._open or self.transmit(arbitration_id, data) is False:
            meter.send_failures += 1
            return False
        meter.sent += 1
        meter.bits += bits
        return True

    def receive(self) -> list[Frame]:
        """Return all frames delivered since the last call, oldest first."""
        frames = self._inbox
        self._inbox = []
        meter = self._meter
        meter.received += len(frames)
        meter.roll(self._clock.now_ns())
        return frames

    def status(self) -> BusStatus:
        """Return the counters since the start."""
        return self._meter.status()

    def close(self) -> None:
        """Leave the bus: nothing more is sent or received."""
        self._open = False
        self._inbox = []
