"""From bus-off back to the bus: 128 sequences of 11 recessive bits.

Source: ISO 11898-1:2015, clause 12.1.4.4; the waiting time before it is Linux's `restart-ms`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_sim.bus.errors import restarted_message

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.bus.port import Port

RECOVERY_SEQUENCES = 128
RECESSIVE_SEQUENCE_BITS = 11


class Recovery:
    """Counts the recessive sequences for the nodes of one bus which are bus-off.

    Parameters
    ----------
    bus
        The bus this belongs to.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._recovering: list[Port] = []
        self._from_ns: dict[str, int] = {}

    def leave(self, port: Port) -> None:
        """Take note that a node went bus-off, and of when its recovery begins."""
        port.statistics.bus_offs += 1
        port._discard_queue()
        if port._restart_ns is not None:
            self._bus.schedule(self._bus.now_ns + port._restart_ns, lambda: self.restart(port))

    def restart(self, port: Port) -> None:
        """Begin the recovery of a node that is bus-off."""
        if not port.counters.bus_off or port._recovery or not port.attached:
            return
        port._recovery = RECOVERY_SEQUENCES
        self._from_ns[port.name] = self._bus.now_ns
        self._recovering.append(port)
        self._check_recovery(port)

    def _sequence_ns(self) -> int:
        return RECESSIVE_SEQUENCE_BITS * self._bus.bit_ns

    def _recessive_since(self, port: Port) -> int:
        """Time from which the idle bus is recessive, as far as this node has watched it.

        Acknowledge delimiter, end of frame and intermission are one sequence of 11 already; so
        are error delimiter and intermission.
        """
        since = self._bus._free_ns - self._sequence_ns()
        return max(since, self._from_ns[port.name])

    def count_recessive(self, start_ns: int) -> None:
        """Credit the pause before a start of frame to the nodes in recovery."""
        for port in tuple(self._recovering):
            pause = start_ns - self._recessive_since(port)
            port._recovery -= max(0, pause // self._sequence_ns())
            if port._recovery <= 0:
                self._recovered(port)

    def _check_recovery(self, port: Port) -> None:
        """Look whether the pauses so far suffice; else come back when they could."""
        if port not in self._recovering:
            return
        bus = self._bus
        rest = port._recovery * self._sequence_ns()
        if bus._senders:
            due = bus._done_ns + rest
        elif bus._disturbance.dominant:
            due = bus.now_ns + rest
        else:
            due = self._recessive_since(port) + rest
        if due <= bus.now_ns:
            self._recovered(port)
        else:
            bus.schedule(due, lambda: self._check_recovery(port))

    def _recovered(self, port: Port) -> None:
        self._recovering.remove(port)
        port._recovery = 0
        if not port.attached:
            return
        port.counters.reset()
        self._bus._rewire()
        self._bus._confinement.deliver([(port, *restarted_message())])
        self._bus._injector.sent(port)
