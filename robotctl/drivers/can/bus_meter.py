"""Counters of every CAN port."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.bus_load import nominal_bits, worst_case_bits
from robotctl.messages.control import BusState, BusStatus

FRAME_BITS: Final = tuple((nominal_bits(n) + worst_case_bits(n)) // 2 for n in range(9))
"""Estimated length of a frame by its data length [bit]: half way between no and full stuffing,
within 9 % of the truth."""

_WINDOW_NS = 1_000_000_000


class BusMeter:
    """Counters and load of one port.

    `load` sees what this port sends and what passes its filters; frames between other nodes are
    not in it.

    Parameters
    ----------
    bitrate
        [bit/s].
    """

    __slots__ = (
        "_bitrate", "_load", "_since_ns", "bits", "error_frames", "received", "send_failures",
        "sent", "state",
    )  # fmt: skip

    def __init__(self, bitrate: int) -> None:
        self.state = BusState.ERROR_ACTIVE
        self.received = 0
        self.sent = 0
        self.send_failures = 0
        self.error_frames = 0
        self.bits = 0
        self._bitrate = bitrate
        self._load = 0.0
        self._since_ns: int | None = None

    def roll(self, now_ns: int) -> None:
        """Once a second, turn the bits seen into the load of that second."""
        since_ns = self._since_ns
        if since_ns is None:
            self._since_ns = now_ns
            self.bits = 0
        elif now_ns - since_ns >= _WINDOW_NS:
            self._load = min(self.bits * 1e9 / ((now_ns - since_ns) * self._bitrate), 1.0)
            self._since_ns = now_ns
            self.bits = 0

    def status(self) -> BusStatus:
        """Return the counters; those of end-to-end protection are not known here."""
        return BusStatus(
            self.state,
            self.received,
            self.sent,
            self.send_failures,
            self.error_frames,
            0,
            0,
            0,
            self._load,
        )
