"""Carries out a `FaultPlan`: matches frames, opens and closes the windows of node faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from firmware_sim.bus.bits import ACK_SLOT_TO_END_BITS, TRAILER_BITS, arbitration_key
from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import (
    AckLess,
    Babble,
    BitErrors,
    Corrupt,
    Cut,
    Delay,
    Destroy,
    Dominant,
    Drop,
    Duplicate,
    Fault,
    FrameFault,
    Mute,
    NodeFault,
    Reorder,
    Stale,
    Unanswered,
)
from firmware_sim.bus.frame import Frame, check_id

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.bus.port import Offer, Port


class Strike(NamedTuple):
    """An error to come on the wire: its kind, the bit at which flags begin, who alone sees it."""

    error: BusError
    bit: int
    receiver: str | None


@dataclass(slots=True)
class _Watch:
    """A frame fault, how often it has fitted and struck, and the last frames that it let pass."""

    fault: FrameFault
    seen: int = 0
    struck: int = 0
    passed: dict[tuple[Port, int], Offer] = field(default_factory=dict)

    @property
    def spent(self) -> bool:
        return self.fault.count is not None and self.struck >= self.fault.count


class Injector:
    """The faults of one bus.

    Parameters
    ----------
    bus
        The bus this belongs to.
    rng
        Generator of all random draws.

    Attributes
    ----------
    watches_sending
        Whether frames must be shown to `sending`.
    watches_wire
        Whether attempts must be shown to `strike`, `losses` and `sent`.
    """

    def __init__(self, bus: Bus, rng: np.random.Generator) -> None:
        self._bus = bus
        self._rng = rng
        self._on_send: list[_Watch] = []
        self._on_wire: list[_Watch] = []
        self._on_delivery: list[_Watch] = []
        self._active: list[NodeFault | Cut] = []
        self._held: dict[tuple[Port, int], Offer] = {}
        self.watches_sending = False
        self.watches_wire = False

    def add(self, fault: Fault) -> None:
        """Begin to carry out a fault.

        Raises
        ------
        TypeError
            If it is only a base class of faults.
        """
        self._forget_past()
        if isinstance(fault, (Delay, Duplicate, Reorder, Stale, Corrupt)):
            self._on_send.append(_Watch(fault))
        elif isinstance(fault, (Destroy, BitErrors)):
            self._on_wire.append(_Watch(fault))
        elif isinstance(fault, Drop):
            self._on_delivery.append(_Watch(fault))
        elif isinstance(fault, Dominant):
            self._bus.schedule(fault.start_ns, self._bus._disturbance.hold_dominant)
            if fault.end_ns is not None:
                self._bus.schedule(fault.end_ns, self._bus._disturbance.release_dominant)
        elif isinstance(fault, (Mute, AckLess, Unanswered, Babble, Cut)):
            if isinstance(fault, Babble):
                check_id(fault.arbitration_id)
            self._bus.schedule(fault.start_ns, lambda: self._open(fault))
            if fault.end_ns is not None:
                self._bus.schedule(fault.end_ns, lambda: self._close(fault))
        else:
            raise TypeError(f"{type(fault).__name__} is no fault of its own")
        self._count_watches()

    def _forget_past(self) -> None:
        """Let go of frame faults whose time is over, so that long runs do not grow."""
        now_ns = self._bus.now_ns
        for watches in (self._on_send, self._on_wire, self._on_delivery):
            watches[:] = [
                watch
                for watch in watches
                if watch.fault.end_ns is None or watch.fault.end_ns > now_ns
            ]

    def _count_watches(self) -> None:
        self._held = {key: offer for key, offer in self._held.items() if key[0].attached}
        babbling = any(isinstance(fault, Babble) for fault in self._active)
        self.watches_sending = bool(self._on_send or self._held)
        self.watches_wire = bool(self._on_wire or self._on_delivery or babbling)

    # Faults of frames

    def sending(self, port: Port, offer: Offer) -> None:
        """Enqueue a frame as the sender's faults have it: changed, twice, later or not in turn."""
        bus = self._bus
        key = port, offer[1]
        held = self._held.pop(key, None)
        if held is not None:
            bus._enqueue(port, offer)
            bus._enqueue(port, held)
            self._count_watches()
            bus._rewire()
            return
        watch = self._first(self._on_send, port.name, offer[1])
        fault = None if watch is None else watch.fault
        if watch is not None and isinstance(fault, Stale):
            bus._enqueue(port, watch.passed.setdefault(key, offer))
            return
        for each in self._on_send:
            if isinstance(each.fault, Stale) and self._fits(each.fault, port.name, offer[1]):
                each.passed[key] = offer
        if isinstance(fault, Reorder):
            self._held[key] = offer
            self._count_watches()
            bus._rewire()
        elif isinstance(fault, Delay):
            bus.schedule(bus.now_ns + fault.delay_ns, lambda: bus._enqueue(port, offer))
        elif isinstance(fault, Corrupt):
            bus._enqueue(port, self._corrupted(offer, fault))
        else:
            bus._enqueue(port, offer)
            if isinstance(fault, Duplicate):
                bus._enqueue(port, offer)

    def strike(self, port: Port, offer: Offer, bits: int) -> Strike | None:
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

    def losses(self, port: Port, frame: Frame) -> set[str | None]:
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
        """Return the first fault that strikes; forget those which cannot strike again."""
        for watch in watches:
            if self._strikes(watch, node, arbitration_id, bits):
                watch.struck += 1
                if watch.spent:
                    watches.remove(watch)
                    self._count_watches()
                    self._bus._rewire()
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
        """Whether a frame is one that a fault may strike now."""
        now_ns = self._bus.now_ns
        return (
            fault.arbitration_id in (None, arbitration_id)
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

    # Faults of nodes

    def attached(self, port: Port) -> None:
        """Put a new port under the faults which hold at the moment."""
        if self._active:
            self._refresh(port)

    def sent(self, port: Port) -> None:
        """Let a babbling node go on at once after a frame of its own."""
        for fault in self._active:
            if isinstance(fault, Babble) and fault.node == port.name and not fault.period_ns:
                self._babble(fault)

    def _open(self, fault: NodeFault | Cut) -> None:
        self._active.append(fault)
        self._count_watches()
        self._refresh_all()
        if isinstance(fault, Babble):
            self._babble(fault)

    def _close(self, fault: NodeFault | Cut) -> None:
        self._active.remove(fault)
        self._count_watches()
        self._refresh_all()

    def _refresh_all(self) -> None:
        for port in self._bus.ports:
            self._refresh(port)
        self._bus._rewire()

    def _refresh(self, port: Port) -> None:
        """Set a port's flags as the present faults want them."""
        faults = [fault for fault in self._active if fault.node in (None, port.name)]
        kinds = {type(fault) for fault in faults}
        port._acknowledges = AckLess not in kinds
        port._unanswered = Unanswered in kinds
        port._muted = Mute in kinds
        if port._muted:
            port._discard_queue()
        if (Cut in kinds) != port._cut:
            self._set_cut(port, cut=Cut in kinds)

    def _set_cut(self, port: Port, *, cut: bool) -> None:
        bus = self._bus
        port._cut = cut
        if cut:
            bus._disturbance.break_frame(port)
            bus._disturbance.send_alone(port)
        else:  # eleven recessive bits make it part of the bus again
            port._joining = bool(bus._senders)
            port._ready_ns = bus.now_ns + 11 * bus.bit_ns

    def _babble(self, fault: Babble) -> None:
        bus = self._bus
        if fault not in self._active:
            return
        port = next((entry for entry in bus.ports if entry.name == fault.node), None)
        if port is not None:
            offer = (arbitration_key(fault.arbitration_id), fault.arbitration_id, fault.data)
            if not (port._queue and port._queue[0] == offer):
                bus._enqueue(port, offer, first=True)
        if fault.period_ns:
            bus.schedule(bus.now_ns + fault.period_ns, lambda: self._babble(fault))
