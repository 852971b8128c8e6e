"""Recovery from bus-off: 128 sequences of 11 recessive bits.

Source: ISO 11898-1:2015, clause 12.1.4.4; the waiting time before it is Linux's `restart-ms`.
"""

from __future__ import annotations

from firmware_sim.bus.errors import restarted_message
from firmware_sim.bus.state import BusState, Message, PortState

RECOVERY_SEQUENCES = 128
RECESSIVE_SEQUENCE_BITS = 11


class BusOffRecovery:
    """Counts the recessive sequences for the nodes of one bus which are bus-off.

    Parameters
    ----------
    bus
        The bus's state.
    """

    def __init__(self, bus: BusState) -> None:
        self._bus = bus
        self._recovering: list[PortState] = []
        self._sequence_ns = RECESSIVE_SEQUENCE_BITS * bus.bit_ns

    def leave(self, port: PortState) -> None:
        """Record that a node went bus-off, and when its recovery begins."""
        port.statistics.bus_offs += 1
        port.discard_queue()
        if port.restart_ns is not None:
            self._bus.schedule(self._bus.now_ns + port.restart_ns, lambda: self.restart(port))

    def restart(self, port: PortState) -> None:
        """Begin the recovery of a node that is bus-off."""
        if not port.counters.bus_off or port.recovery or port.detached:
            return
        port.recovery = RECOVERY_SEQUENCES
        port.recovery_ns = self._bus.now_ns
        self._recovering.append(port)
        self._check(port)

    def _recessive_since(self, port: PortState) -> int:
        """Time from which the idle bus is recessive, as far as this node has watched it.

        Acknowledge delimiter, end of frame and intermission are one sequence of 11 already; so
        are error delimiter and intermission.
        """
        return max(self._bus.free_ns - self._sequence_ns, port.recovery_ns)

    def count_recessive(self, start_ns: int) -> None:
        """Credit the pause before a start of frame to the nodes in recovery."""
        for port in tuple(self._recovering):
            pause = start_ns - self._recessive_since(port)
            port.recovery -= max(0, pause // self._sequence_ns)
            if port.recovery <= 0:
                self._recovered(port)

    def _check(self, port: PortState) -> None:
        """Check whether the pauses so far suffice; otherwise retry when they could."""
        if port not in self._recovering:
            return
        bus = self._bus
        rest = port.recovery * self._sequence_ns
        if bus.senders:
            due = bus.done_ns + rest
        elif bus.dominant:
            due = bus.now_ns + rest
        else:
            due = self._recessive_since(port) + rest
        if due <= bus.now_ns:
            self._recovered(port)
        else:
            bus.schedule(due, lambda: self._check(port))

    def _recovered(self, port: PortState) -> None:
        self._recovering.remove(port)
        port.recovery = 0
        if port.detached:
            return
        port.counters.reset()
        self._bus.rewire()
        self._bus.deliver([Message(port, *restarted_message())])
        for offer in port.babbles:
            self._bus.babble(port, offer)
