"""Faults of frames: which frame a fault strikes, and the result."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from firmware_sim.bus.bits import ACK_SLOT_TO_END_BITS, TRAILER_BITS
from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import (
    BitErrors,
    Corrupt,
    Delay,
    Destroy,
    Drop,
    Duplicate,
    FrameFault,
    Reorder,
    Stale,
)
from firmware_sim.bus.frame import EXACT_MASK, Frame
from firmware_sim.bus.state import BusState, Offer, PortState


class Strike(NamedTuple):
    """An upcoming error on the wire: kind, first bit of its flags, who alone sees it."""

    error: BusError
    bit: int
    receiver: str | None


@dataclass(slots=True)
class _Watch:
    """Frame fault, its numbers of matches and strikes, and the last frames it let pass."""

    fault: FrameFault
    seen: int = 0
    struck: int = 0
    passed: dict[tuple[PortState, int], Offer] = field(default_factory=dict)

    @property
    def spent(self) -> bool:
        return self.fault.count is not None and self.struck >= self.fault.count


class FrameFaults:
    """The faults of the frames of one bus.

    Parameters
    ----------
    bus
        The bus's state.
    rng
        Generator of all random draws.
    """

    def __init__(self, bus: BusState, rng: np.random.Generator) -> None:
        self._bus = bus
        self._rng = rng
        self._on_send: list[_Watch] = []
        self._on_wire: list[_Watch] = []
        self._on_delivery: list[_Watch] = []
        self._held: dict[tuple[PortState, int], Offer] = {}

    def add(self, fault: FrameFault) -> None:
        """Start a fault.

        Raises
        ------
        TypeError
            If it is only the base class.
        """
        if isinstance(fault, (Delay, Duplicate, Reorder, Stale, Corrupt)):
            self._on_send.append(_Watch(fault))
        elif isinstance(fault, (Destroy, BitErrors)):
            self._on_wire.append(_Watch(fault))
        elif isinstance(fault, Drop):
            self._on_delivery.append(_Watch(fault))
        else:
            raise TypeError(f"{type(fault).__name__} is no fault of its own")

    def forget_past(self) -> None:
        """Drop faults whose time is over, so that memory stays bounded in long runs."""
        now_ns = self._bus.now_ns
        for watches in (self._on_send, self._on_wire, self._on_delivery):
            watches[:] = [
                watch
                for watch in watches
                if watch.fault.end_ns is None or watch.fault.end_ns > now_ns
            ]

    def rewire(self) -> None:
        """Tell the bus which events the remaining faults need."""
        self._held = {key: offer for key, offer in self._held.items() if not key[0].detached}
        self._bus.watches_sending = bool(self._on_send or self._held)
        self._bus.watches_wire = bool(self._on_wire or self._on_delivery)
        self._bus.rewire()

    def sending(self, port: PortState, offer: Offer) -> None:
        """Enqueue a frame with the sender's faults: changed, twice, late or out of order."""
        bus = self._bus
        key = port, offer[1]
        held = self._held.pop(key, None)
        if held is not None:
            bus.enqueue(port, offer)
            bus.enqueue(port, held)
            self.rewire()
            return
        watch = self._first(self._on_send, port.name, offer[1])
        fault = None if watch is None else watch.fault
        if watch is not None and isinstance(fault, Stale):
            bus.enqueue(port, watch.passed.setdefault(key, offer))
            return
        for each in self._on_send:
            if isinstance(each.fault, Stale) and self._fits(each.fault, port.name, offer[1]):
                each.passed[key] = offer
        if isinstance(fault, Reorder):
            self._held[key] = offer
            self.rewire()
        elif isinstance(fault, Delay):
            bus.schedule(bus.now_ns + fault.delay_ns, lambda: bus.enqueue(port, offer))
        elif isinstance(fault, Corrupt):
            bus.enqueue(port, self._corrupted(offer, fault))
        else:
            bus.enqueue(port, offer)
            if isinstance(fault, Duplicate):
                bus.enqueue(port, offer)

    def strike(self, port: PortState, offer: Offer, bits: int) -> Strike | None:
        """Return the error that will destroy this attempt, if any."""
        watch = self._first(self._on_wire, port.name, offer[1], bits)
        if watch is None:
            return None
        fault = watch.fault
        if isinstance(fault, BitErrors):
            chance = -math.expm1((bits - 1) * math.log1p(-fault.rate))
            where = math.log1p(-self._rng.random() * chance) / math.log1p(-fault.rate)
            return Strike(BusError.BIT_ERROR, min(1 + int(where), bits - 1), None)
        if not isinstance(fault, Destroy):
            raise TypeError(f"{type(fault).__name__} is no fault of the wire")
        if fault.bit is not None:
            bit = min(fault.bit, bits - 1)
        elif fault.error is BusError.CRC_ERROR:  # flags begin after the acknowledge delimiter
            bit = bits - ACK_SLOT_TO_END_BITS + 1
        elif fault.error is BusError.FORM_ERROR:  # at the CRC delimiter
            bit = bits - TRAILER_BITS + 1
        else:
            bit = int(self._rng.integers(1, bits - TRAILER_BITS))
        return Strike(fault.error, bit, fault.receiver)

    def losses(self, port: PortState, frame: Frame) -> set[str | None]:
        """Return the names of the receivers which lose the frame; None among them: all do."""
        if not self._on_delivery:
            return set()
        watch = self._first(self._on_delivery, port.name, frame.arbitration_id)
        if watch is None or not isinstance(watch.fault, Drop):
            return set()
        return {watch.fault.receiver}

    def _first(
        self, watches: list[_Watch], node: str, arbitration_id: int, bits: int = 0
    ) -> _Watch | None:
        """Return the first fault that strikes; drop those that cannot strike again."""
        for watch in watches:
            if self._strikes(watch, node, arbitration_id, bits):
                watch.struck += 1
                if watch.spent:
                    watches.remove(watch)
                    self.rewire()
                return watch
        return None

    def _strikes(self, watch: _Watch, node: str, arbitration_id: int, bits: int) -> bool:
        fault = watch.fault
        if not self._fits(fault, node, arbitration_id):
            return False
        watch.seen += 1
        if watch.seen <= fault.first:
            return False
        chance = fault.probability
        if isinstance(fault, BitErrors):
            chance *= -math.expm1((bits - 1) * math.log1p(-fault.rate))
        return chance >= 1.0 or bool(self._rng.random() < chance)

    def _fits(self, fault: FrameFault, node: str, arbitration_id: int) -> bool:
        """Whether a fault may strike a frame now."""
        now_ns = self._bus.now_ns
        return (
            fault.arbitration_id in (None, arbitration_id, arbitration_id & EXACT_MASK)
            and fault.node in (None, node)
            and fault.start_ns <= now_ns
            and (fault.end_ns is None or now_ns < fault.end_ns)
        )

    def _corrupted(self, offer: Offer, fault: Corrupt) -> Offer:
        key, arbitration_id, data = offer
        if not data:
            return offer
        changed = bytearray(data)
        if fault.xor is None:
            bit = int(self._rng.integers(8 * len(data)))
            changed[bit // 8] ^= 1 << bit % 8
        else:
            for index, mask in enumerate(fault.xor[: len(data)]):
                changed[index] ^= mask
        return key, arbitration_id, bytes(changed)
