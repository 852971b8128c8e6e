"""Counters of every CAN port."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from robotctl.drivers.can.bus_load import nominal_bits, worst_case_bits
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.errors import CAN_ERR_FLAG
from robotctl.messages.control import BusState, BusStatus
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS

FRAME_BITS: Final = tuple(
    (nominal_bits(0, n).nominal + worst_case_bits(0, n).nominal) // 2 for n in range(9)
)
"""Estimated length of a classic data frame with an 11-bit identifier by its data length [bit]."""

_WINDOW_NS = 1_000_000_000
"""Time over which the load is averaged [ns]."""
_FORMATS: Final = EXTENDED_FLAG | FD_FLAG


class _All(dict[int, tuple[int, ...]]):
    """Lengths of frames of every identifier, made of those by format."""

    def get(self, key: int, _: object = None) -> tuple[int, ...] | None:  # type: ignore[override]
        """Return the lengths by data length; None for an error frame, and CAN FD without that."""
        return None if key & CAN_ERR_FLAG else super().get(key & _FORMATS)


class BusMeter:
    """Counters and load of one port.

    `load` sees what this port sends and what passes its filters; frames between other nodes are
    not in it. Lengths are estimates half way between no and full stuffing, within 12 % of the
    truth.

    Parameters
    ----------
    config
        Which bus.

    Attributes
    ----------
    bits
        Time of the frames of this second, in bits of the bus's bit rate.
    """

    __slots__ = (
        "_bitrate", "_lengths", "_load", "_since_ns", "bits", "error_frames", "received",
        "send_failures", "sent", "state",
    )  # fmt: skip

    def __init__(self, config: CanConfig) -> None:
        self.state = BusState.ERROR_ACTIVE
        self.received = 0
        self.sent = 0
        self.send_failures = 0
        self.error_frames = 0
        self.bits = 0
        self._bitrate = config.bitrate
        self._lengths = {
            flags: _lengths(config, flags)
            for flags in (0, EXTENDED_FLAG, FD_FLAG, EXTENDED_FLAG | FD_FLAG)
            if config.data_bitrate or not flags & FD_FLAG
        }
        self._load = 0.0
        self._since_ns: int | None = None

    def measure(self, arbitration_id: int, length: int) -> int:
        """Return the length of a frame by identifier, with flags as in `Frame`, and data length.

        0 if the bus carries no such frame.
        """
        lengths = self._lengths.get(arbitration_id & _FORMATS, ())
        return lengths[length] if length < len(lengths) else 0

    def accepted(self, arbitration_ids: Collection[int] | None) -> dict[int, tuple[int, ...]]:
        """Return the lengths of frames of identifiers by their data length, where there are any.

        None: those of all identifiers.
        """
        if arbitration_ids is None:
            return _All(self._lengths)
        formats = {each: self._lengths.get(each & _FORMATS) for each in arbitration_ids}
        return {each: lengths for each, lengths in formats.items() if lengths is not None}

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


def _lengths(config: CanConfig, flags: int) -> tuple[int, ...]:
    """Return the estimated lengths of frames of a format by their data length; 0: none is so long.

    Unit: bits of the bus's bit rate.
    """
    allowed = FD_LENGTHS if flags & FD_FLAG else range(9)
    seconds = {
        n: (nominal_bits(flags, n).seconds(config) + worst_case_bits(flags, n).seconds(config)) / 2
        for n in allowed
    }
    return tuple(round(seconds.get(n, 0) * config.bitrate) for n in range(allowed[-1] + 1))
