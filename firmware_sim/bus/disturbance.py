"""Disturbances of the cable: a cut wire, a bus held dominant.

Source: ISO 11898-1:2015, clause 12.1.4, rules e and f for the dominant bus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_sim.bus.bits import ACK_SLOT_TO_END_BITS, INTERMISSION_BITS, frame_bits
from firmware_sim.bus.confinement import DELIMITER_BITS, FLAG_BITS, Failure
from firmware_sim.bus.errors import BusError

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.bus.port import Port

_FAR_NS = 1 << 62


class Disturbance:
    """The state of the cable of one bus.

    Parameters
    ----------
    bus
        The bus this belongs to.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._alone: set[str] = set()
        self._dominant = 0
        self._dominant_since_ns = 0
        self._hit: tuple[Port, ...] = ()

    @property
    def dominant(self) -> bool:
        """Whether the bus is held dominant at present."""
        return self._dominant > 0

    def break_frame(self, lost: Port | None) -> None:
        """Destroy the frame on the wire now, if there is one, because `lost` (None: all) is gone.

        The receivers see recessive bits where stuff bits should be.
        """
        bus = self._bus
        if not bus._senders:
            return
        if lost is not None and lost not in bus._senders:
            lost.counters.receive_error()
            return
        heard = tuple(port for port in bus._ports.values() if port._on_bus and not port._joining)
        bus._failure = Failure(
            BusError.BIT_STUFFING_ERROR,
            tuple(port for port in bus._senders if port in heard),
            (),
            tuple(port for port in heard if port not in bus._senders),
            2 * FLAG_BITS,
        )
        bus._confinement.fail()

    def send_alone(self, port: Port) -> None:
        """Let a cut-off node try to send: nobody acknowledges, up to error-passive."""
        if port.name in self._alone or not port._queue:
            return
        self._alone.add(port.name)
        bus = self._bus
        _, arbitration_id, data = port._queue[0]
        bits = frame_bits(arbitration_id, data) - ACK_SLOT_TO_END_BITS
        bits += FLAG_BITS + DELIMITER_BITS + INTERMISSION_BITS
        bus.schedule(bus.now_ns + bits * bus.bit_ns, lambda: self._unanswered(port))

    def _unanswered(self, port: Port) -> None:
        self._alone.discard(port.name)
        if not (port._cut and port._queue and port.attached):
            return
        before = self._bus._confinement.states()
        failure = Failure(BusError.ACK_ERROR, (port,), (), (), FLAG_BITS)
        messages = self._bus._confinement.count(failure)
        if port._closing:
            port.detach()
            return
        if messages:
            self.send_alone(port)
        messages += self._bus._confinement.changes(before, messages)
        self._bus._confinement.deliver(messages)

    def hold_dominant(self) -> None:
        """Turn the bus dominant, on top of what holds it dominant already."""
        self._dominant += 1
        if self._dominant > 1:
            return
        bus = self._bus
        self._hit = bus._senders
        if bus._senders:
            bus._meter.busy_bits += (bus.now_ns - bus._start_ns) // bus.bit_ns
            self._bus._confinement.put_back(unanswered=False)
            self._bus._confinement.integrate()
        bus._free_ns = _FAR_NS
        self._dominant_since_ns = since_ns = bus.now_ns
        bus.statistics.count_error(BusError.BROKEN_ERROR)
        bus.schedule(since_ns + FLAG_BITS * bus.bit_ns, self._first_dominant_error)

    def release_dominant(self) -> None:
        """Take one cause away; without any, the bus is free after the error delimiter."""
        self._dominant -= 1
        if self._dominant:
            return
        bus = self._bus
        flags_end_ns = self._dominant_since_ns + 2 * FLAG_BITS * bus.bit_ns
        quiet_bits = DELIMITER_BITS + INTERMISSION_BITS
        bus._free_ns = max(bus.now_ns, flags_end_ns) + quiet_bits * bus.bit_ns
        bus._meter.busy_bits += (bus._free_ns - self._dominant_since_ns) // bus.bit_ns

    def _first_dominant_error(self) -> None:
        """Everybody sees six dominant bits and answers with an error flag."""
        bus = self._bus
        self._dominant_error(first=True)
        self._bus._confinement.observe(BusError.BROKEN_ERROR)
        since_ns = self._dominant_since_ns
        bus.schedule(since_ns + 20 * bus.bit_ns, lambda: self._next_dominant_error(since_ns))

    def _next_dominant_error(self, since_ns: int) -> None:
        """Rule f: after the flag, each further 8 dominant bits count 8."""
        still = self._dominant and self._dominant_since_ns == since_ns
        if still and self._dominant_error(first=False):
            bus = self._bus
            bus.schedule(bus.now_ns + 8 * bus.bit_ns, lambda: self._next_dominant_error(since_ns))

    def _dominant_error(self, *, first: bool) -> bool:
        """Count one error of the dominant bus for everybody; tell whether anything changed."""
        ports = tuple(port for port in self._bus._ports.values() if port._on_bus)
        failure = Failure(
            BusError.BROKEN_ERROR,
            tuple(port for port in ports if port in self._hit),
            (),
            tuple(port for port in ports if port not in self._hit) if first else (),
            FLAG_BITS,
        )
        before = self._bus._confinement.states()
        old = {port: port.counters.rec for port in ports}
        messages = self._bus._confinement.count(failure)
        if not first:
            for port in ports:
                if port not in self._hit:
                    port.counters.receive_error_first()
        changed = bool(messages) or any(port.counters.rec != old[port] for port in ports)
        messages += self._bus._confinement.changes(before, messages)
        self._bus._confinement.deliver(messages)
        return changed
