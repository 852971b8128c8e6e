"""Disturbances of the cable: a cut wire, a bus held dominant.

Source: ISO 11898-1:2015, clause 12.1.4, rules e and f for the dominant bus.
"""

from __future__ import annotations

from firmware_sim.bus.bits import ACK_SLOT_TO_END_BITS, INTERMISSION_BITS
from firmware_sim.bus.confinement import DELIMITER_BITS, FLAG_BITS, Confinement
from firmware_sim.bus.errors import BusError
from firmware_sim.bus.fd_bits import frame_length
from firmware_sim.bus.state import NEVER_NS, BusState, Failure, PortState


class Disturbance:
    """The state of the cable of one bus.

    Parameters
    ----------
    bus
        The bus's state.
    confinement
        Owner of its error counters.
    """

    def __init__(self, bus: BusState, confinement: Confinement) -> None:
        self._bus = bus
        self._confinement = confinement
        bus.cut_off = self.send_alone
        self._dominant_since_ns = 0
        self._hit: tuple[PortState, ...] = ()

    def break_frame(self, lost: PortState | None) -> None:
        """Destroy a frame on the wire now, because `lost` (None: every node) is disconnected.

        The receivers see recessive bits where stuff bits should be.
        """
        bus = self._bus
        if not bus.senders:
            return
        if lost is not None and lost not in bus.senders:
            lost.counters.receive_error()
            return
        heard = tuple(
            port
            for port in bus.ports.values()
            if port.on_bus and not port.joining and not port.ignores(bus.offer[1])
        )
        bus.failure = Failure(
            BusError.BIT_STUFFING_ERROR,
            tuple(port for port in bus.senders if port in heard),
            (),
            tuple(port for port in heard if port not in bus.senders),
            2 * FLAG_BITS,
        )
        self._confinement.fail()

    def send_alone(self, port: PortState) -> None:
        """Let a cut-off node try to send: no acknowledgement, up to error-passive."""
        if port.alone or not port.queue:
            return
        port.alone = True
        bus = self._bus
        _, arbitration_id, data = port.queue[0]
        length = frame_length(arbitration_id, data)
        attempt_ns = bus.duration_ns(length, length.bits - ACK_SLOT_TO_END_BITS)
        attempt_ns += (FLAG_BITS + DELIMITER_BITS + INTERMISSION_BITS) * bus.bit_ns
        bus.schedule(bus.now_ns + attempt_ns, lambda: self._unanswered(port))

    def _unanswered(self, port: PortState) -> None:
        port.alone = False
        if not (port.cut and port.queue and not port.detached):
            return
        before = self._confinement.states()
        failure = Failure(BusError.ACK_ERROR, (port,), (), (), FLAG_BITS)
        messages = self._confinement.count(failure)
        if port.closing:
            self._bus.detach(port)
            return
        if messages:
            self.send_alone(port)
        messages += self._confinement.changes(before, messages)
        self._bus.deliver(messages)

    def hold_dominant(self) -> None:
        """Add one cause that holds the bus dominant."""
        self._bus.dominant += 1
        if self._bus.dominant > 1:
            return
        bus = self._bus
        self._hit = bus.senders
        if bus.senders:
            bus.meter.busy_ns += bus.now_ns - bus.start_ns
            self._confinement.put_back(unanswered=False)
            self._confinement.integrate()
        bus.free_ns = NEVER_NS
        self._dominant_since_ns = since_ns = bus.now_ns
        bus.statistics.count_error(BusError.BROKEN_ERROR)
        bus.schedule(since_ns + FLAG_BITS * bus.bit_ns, self._first_dominant_error)

    def release_dominant(self) -> None:
        """Remove one cause; after the last one the bus is free once the error delimiter is over."""
        self._bus.dominant -= 1
        if self._bus.dominant:
            return
        bus = self._bus
        flags_end_ns = self._dominant_since_ns + 2 * FLAG_BITS * bus.bit_ns
        quiet_bits = DELIMITER_BITS + INTERMISSION_BITS
        bus.free_ns = max(bus.now_ns, flags_end_ns) + quiet_bits * bus.bit_ns
        bus.meter.busy_ns += bus.free_ns - self._dominant_since_ns

    def _first_dominant_error(self) -> None:
        """Let every node see six dominant bits and answer with an error flag."""
        bus = self._bus
        self._dominant_error(first=True)
        self._confinement.observe(BusError.BROKEN_ERROR)
        since_ns = self._dominant_since_ns
        bus.schedule(since_ns + 20 * bus.bit_ns, lambda: self._next_dominant_error(since_ns))

    def _next_dominant_error(self, since_ns: int) -> None:
        """Apply rule f: each further 8 dominant bits after the flag add 8."""
        still = self._bus.dominant and self._dominant_since_ns == since_ns
        if still and self._dominant_error(first=False):
            bus = self._bus
            bus.schedule(bus.now_ns + 8 * bus.bit_ns, lambda: self._next_dominant_error(since_ns))

    def _dominant_error(self, *, first: bool) -> bool:
        """Count one error of the dominant bus for all nodes; return whether anything changed."""
        ports = tuple(port for port in self._bus.ports.values() if port.on_bus)
        failure = Failure(
            BusError.BROKEN_ERROR,
            tuple(port for port in ports if port in self._hit),
            (),
            tuple(port for port in ports if port not in self._hit) if first else (),
            FLAG_BITS,
        )
        before = self._confinement.states()
        old = {port: port.counters.rec for port in ports}
        messages = self._confinement.count(failure)
        if not first:
            for port in ports:
                if port not in self._hit:
                    port.counters.receive_error_first()
        changed = bool(messages) or any(port.counters.rec != old[port] for port in ports)
        messages += self._confinement.changes(before, messages)
        self._bus.deliver(messages)
        return changed
