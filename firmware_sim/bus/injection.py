"""Applies a `FaultPlan`: passes on faults of frames, opens and closes the windows of others."""

from __future__ import annotations

from firmware_sim.bus.bits import arbitration_key
from firmware_sim.bus.disturbance import Disturbance
from firmware_sim.bus.faults import (
    AckLess,
    Babble,
    Cut,
    Dominant,
    Fault,
    FrameFault,
    Mute,
    NodeFault,
    Unanswered,
)
from firmware_sim.bus.frame_faults import FrameFaults
from firmware_sim.bus.state import BusState, Offer, PortState


class Injector:
    """The faults of one bus.

    Parameters
    ----------
    bus
        The bus's state.
    frames
        The faults of its frames.
    disturbance
        Faults of its cable.
    """

    def __init__(self, bus: BusState, frames: FrameFaults, disturbance: Disturbance) -> None:
        self._bus = bus
        self._frames = frames
        self._disturbance = disturbance
        self._active: list[NodeFault | Cut] = []

    def add(self, fault: Fault) -> None:
        """Start a fault; its window may have begun already.

        Raises
        ------
        TypeError
            If it is only a base class of faults.
        """
        self._frames.forget_past()
        if isinstance(fault, FrameFault):
            self._frames.add(fault)
        elif isinstance(fault, Dominant):
            self._bus.schedule(fault.start_ns, self._disturbance.hold_dominant)
            if fault.end_ns is not None:
                self._bus.schedule(fault.end_ns, self._disturbance.release_dominant)
        elif isinstance(fault, (Mute, AckLess, Unanswered, Babble, Cut)):
            if isinstance(fault, Babble):
                self._bus.check(fault.arbitration_id, len(fault.data))
            self._bus.schedule(fault.start_ns, lambda: self._open(fault))
            if fault.end_ns is not None:
                self._bus.schedule(fault.end_ns, lambda: self._close(fault))
        else:
            raise TypeError(f"{type(fault).__name__} is no fault of its own")
        self._frames.rewire()

    def attached(self, port: PortState) -> None:
        """Apply the active faults to a new port."""
        if self._active:
            self._refresh(port)

    def _open(self, fault: NodeFault | Cut) -> None:
        self._active.append(fault)
        self._refresh_all()
        if isinstance(fault, Babble):
            self._babble(fault)

    def _close(self, fault: NodeFault | Cut) -> None:
        self._active.remove(fault)
        self._refresh_all()

    def _refresh_all(self) -> None:
        self._bus.babbling = any(isinstance(fault, Babble) for fault in self._active)
        for port in tuple(self._bus.ports.values()):
            self._refresh(port)
        self._bus.rewire()

    def _refresh(self, port: PortState) -> None:
        """Apply the active faults to a port."""
        faults = [fault for fault in self._active if fault.node in (None, port.name)]
        kinds = {type(fault) for fault in faults}
        port.acknowledges = AckLess not in kinds
        port.unanswered = Unanswered in kinds
        port.muted = Mute in kinds
        port.babbles = tuple(
            _offer(fault) for fault in faults if isinstance(fault, Babble) and not fault.period_ns
        )
        if port.muted:
            port.discard_queue()
        if (Cut in kinds) != port.cut:
            self._set_cut(port, cut=Cut in kinds)

    def _set_cut(self, port: PortState, *, cut: bool) -> None:
        bus = self._bus
        port.cut = cut
        if cut:
            self._disturbance.break_frame(port)
            self._disturbance.send_alone(port)
        else:  # eleven recessive bits make it part of the bus again
            port.joining = bool(bus.senders)
            port.ready_ns = bus.now_ns + 11 * bus.bit_ns

    def _babble(self, fault: Babble) -> None:
        """Send a babbling node's frame, now and every period."""
        bus = self._bus
        if fault not in self._active:
            return
        port = bus.ports.get(fault.node)
        if port is not None:
            bus.babble(port, _offer(fault))
        if fault.period_ns:
            bus.schedule(bus.now_ns + fault.period_ns, lambda: self._babble(fault))


def _offer(fault: Babble) -> Offer:
    return arbitration_key(fault.arbitration_id), fault.arbitration_id, fault.data
