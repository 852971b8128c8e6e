"""What happens on the wire when not all is well: collisions, error frames, bus-off, recovery.

Source: ISO 11898-1:2015, clause 10.11 (error signalling) and 12.1.4 (fault confinement). An error
flag takes 6 bits, with the others' flags up to 12, the error delimiter 8; a frame is destroyed
for all nodes or, when only error-passive nodes object, for none but them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from firmware_sim.bus.bits import (
    ACK_SLOT_TO_END_BITS,
    INTERMISSION_BITS,
    frame_bit_sequence,
    frame_bits,
)
from firmware_sim.bus.errors import (
    BusError,
    ErrorClass,
    ErrorCounters,
    ErrorState,
    bus_error_message,
    state_message,
)
from firmware_sim.bus.frame import ERROR_FLAG, Frame

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.bus.injection import Strike
    from firmware_sim.bus.port import Offer, Port, Route

FLAG_BITS = 6
DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""An error-passive transmitter lets others go first for so long after the intermission."""


class Failure(NamedTuple):
    """Decided at the start of a frame: how it will be destroyed.

    Attributes
    ----------
    error
        What the first to see it sees.
    transmitters
        Nodes which send and see their frame destroyed.
    first
        Receivers which see it first.
    others
        Receivers which see the first ones' error flag.
    flag_bits
        Length of the superposed error flags.
    outlasted
        Whether another's active flag goes on behind those of `first` (rule b).
    """

    error: BusError
    transmitters: tuple[Port, ...]
    first: tuple[Port, ...]
    others: tuple[Port, ...]
    flag_bits: int
    outlasted: bool = False


class Confinement:
    """Runs the attempts which `Bus` does not run itself, and keeps the error counters.

    Parameters
    ----------
    bus
        The bus this belongs to.

    Attributes
    ----------
    hopeless
        Whether the last attempt was a lone error-passive node's: nothing comes of the next ones
        either, until somebody else comes or sends.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._popped: tuple[tuple[Port, Offer], ...] = ()
        self._dropouts: tuple[Port, ...] = ()
        self._deaf: tuple[Port, ...] = ()
        self.hopeless = False

    # One attempt to send

    def begin(self, start_ns: int) -> None:
        """Start the most urgent frame and decide how it will end."""
        bus = self._bus
        bus._recovery.count_recessive(start_ns)
        offering = [port for port in bus._offers if port._ready_ns <= start_ns]
        key = min(port._queue[0][0] for port in offering)
        contenders = tuple(port for port in offering if port._queue[0][0] == key)
        for port in offering:
            if port not in contenders:
                port.statistics.arbitration_lost += 1
        survivors, collision_bit = self._collide(contenders)
        self._popped = tuple((port, port._queue.popleft()) for port in survivors)
        bus._offers[:] = [port for port in bus._offers if port._queue]
        bus._senders = survivors
        bus._offer = self._popped[0][1]
        _, arbitration_id, data = bus._offer
        bus._bits = frame_bits(arbitration_id, data)
        end_bit = self._decide(survivors, collision_bit)
        bus._done_ns = start_ns + end_bit * bus.bit_ns

    def _collide(self, contenders: tuple[Port, ...]) -> tuple[tuple[Port, ...], int | None]:
        """Resolve several nodes sending one id.

        Returns those still sending, and the bit at which an error flag destroys all; None where
        their frames are equal, or where only error-passive nodes had to give way.
        """
        self._dropouts = ()
        while len({port._queue[0] for port in contenders}) > 1:
            streams = {port: frame_bit_sequence(*port._queue[0][1:]) for port in contenders}
            shortest = min(len(stream) for stream in streams.values())
            bit = next(
                index
                for index in range(shortest)
                if len({stream[index] for stream in streams.values()}) > 1
            )
            losers = tuple(port for port in contenders if streams[port][bit] == 1)
            if any(not port.counters.passive for port in losers):
                return contenders, bit + 1
            self._dropouts += losers
            contenders = tuple(port for port in contenders if port not in losers)
        return contenders, None

    def _decide(self, senders: tuple[Port, ...], collision_bit: int | None) -> int:
        """Set the bus's failure, if any; return the bit at which the attempt is over."""
        bus = self._bus
        busy = senders + self._dropouts
        receivers = tuple(
            port
            for port in bus._ports.values()
            if port._on_bus and not port._joining and port not in busy
        )
        self._deaf = ()
        if collision_bit is not None:
            bus._failure = Failure(BusError.BIT_ERROR, senders, (), receivers, 2 * FLAG_BITS)
            return collision_bit
        strike = bus._injector.strike(senders[0], bus._offer, bus._bits)
        if strike is not None:
            bus._failure = self._strike(strike, senders, receivers)
            if bus._failure is not None:
                return strike.bit
        if self._answered(senders, receivers):
            return bus._bits
        # An error-passive sender's flag is recessive: nobody else sees that it objects.
        seen_by = () if senders[0].counters.passive else receivers
        active = any(not port.counters.passive for port in seen_by)
        flag_bits = 2 * FLAG_BITS if active else FLAG_BITS
        bus._failure = Failure(BusError.ACK_ERROR, senders, (), seen_by, flag_bits)
        return bus._bits - ACK_SLOT_TO_END_BITS

    def _answered(self, senders: tuple[Port, ...], receivers: tuple[Port, ...]) -> bool:
        """Tell whether one of the receivers acknowledges a frame."""
        answering = any(port._answers and port not in self._deaf for port in receivers)
        return answering and not any(port._unanswered for port in senders)

    def _strike(
        self, strike: Strike, senders: tuple[Port, ...], receivers: tuple[Port, ...]
    ) -> Failure | None:
        """Turn an injected error into its consequences; None where the frame survives it."""
        if strike.error is BusError.BIT_ERROR:
            return Failure(strike.error, senders, (), receivers, 2 * FLAG_BITS)
        first = tuple(port for port in receivers if strike.receiver in (None, port.name))
        if not first:
            return None
        if strike.receiver is not None and first[0].counters.passive:
            self._deaf = first  # its passive error flag disturbs nobody
            return None
        others = tuple(port for port in receivers if port not in first)
        # Flags of a CRC error wait for the acknowledge delimiter. Where nobody has acknowledged,
        # that of the transmitter is there before them, and ends before them.
        early = strike.error is BusError.CRC_ERROR and not self._answered(senders, others)
        outlasted = not early and any(not port.counters.passive for port in senders + others)
        flag_bits = FLAG_BITS + outlasted
        return Failure(strike.error, senders, first, others, flag_bits, outlasted)

    def complete(self, senders: tuple[Port, ...], route: Route, frame: Frame) -> None:
        """Count and deliver a frame that has got through."""
        bus = self._bus
        before = self.states()
        deaf = self._deaf + self._dropouts + senders
        self._count_success(senders, deaf)
        self._popped = self._dropouts = self._deaf = ()
        self.integrate()
        messages = self.changes(before)
        lost = bus._injector.losses(senders[0], frame)
        for observe in bus._observers(frame.arbitration_id):
            observe(frame)
        for port in route.ports:
            if port not in deaf and not lost & {None, port.name}:
                port._receive(frame)
        self.deliver(messages)
        for port in senders:
            if port._on_sent is not None:
                port._on_sent(frame)
            bus._injector.sent(port)
            if port._closing and port.attached:
                bus._leave_if_done(port)

    def _count_success(self, senders: tuple[Port, ...], deaf: tuple[Port, ...]) -> None:
        """Apply the counting rules to a frame that has got through."""
        for port in senders:
            port.counters.transmitted()
            port.statistics.sent += 1
            self._suspend(port)
        for port in self._dropouts:
            port.counters.transmit_error()
            port.statistics.errors += 1
        for port in self._deaf:
            port.counters.receive_error()
            port.statistics.errors += 1
        for port in self._bus._ports.values():
            if port._on_bus and not port._joining and port not in deaf:
                port.counters.received()

    def fail(self) -> None:
        """Destroy the frame on the wire: error flags, counters, retransmission."""
        bus = self._bus
        failure = bus._failure
        if failure is None:
            raise RuntimeError("no failure has been decided")
        before = self.states()
        messages = self.count(failure)
        _, arbitration_id, _ = bus._offer
        bus.statistics.count_error(failure.error)
        bus.statistics.of(arbitration_id).errors += 1
        dead_bits = failure.flag_bits + DELIMITER_BITS + INTERMISSION_BITS
        bus._free_ns = bus.now_ns + dead_bits * bus.bit_ns
        bus._meter.busy_bits += (bus.now_ns - bus._start_ns) // bus.bit_ns + dead_bits
        for port in failure.transmitters:
            self._suspend(port)
        self.put_back(unanswered=failure.error is BusError.ACK_ERROR)
        self.integrate()
        changed = bool(messages)
        messages += self.changes(before, messages)
        alone = len(bus._offers) == 1 and not bus._offers[0]._heard
        alone = alone and not bus._injector.watches_wire
        self.hopeless = not changed and alone and failure.error is BusError.ACK_ERROR
        if self.hopeless:
            self._skip(failure.error, dead_bits)
        if changed:
            self.observe(failure.error)
        self.deliver(messages)

    def _skip(self, error: BusError, dead_bits: int) -> None:
        """Count the coming attempts of a lone node at once, as far as time will pass now."""
        bus = self._bus
        port = bus._offers[0]
        attempt_bits = bus._bits - ACK_SLOT_TO_END_BITS
        period_bits = attempt_bits + dead_bits + SUSPEND_BITS
        until_ns = min(bus._until_ns, bus._timer_ns)
        first_end_ns = port._ready_ns + attempt_bits * bus.bit_ns
        if port._queue[0] is not bus._offer or until_ns < first_end_ns:
            return
        count = 1 + (until_ns - first_end_ns) // (period_bits * bus.bit_ns)
        bus._free_ns += count * period_bits * bus.bit_ns
        port._ready_ns += count * period_bits * bus.bit_ns
        port.statistics.errors += count
        bus.statistics.count_error(error, count)
        bus.statistics.of(bus._offer[1]).errors += count
        bus._meter.busy_bits += count * (attempt_bits + dead_bits)

    def count(self, failure: Failure) -> list[tuple[Port, ErrorClass, bytearray]]:
        """Apply the counting rules; return the messages for those whose counters changed."""
        hurt: list[tuple[Port, bool, tuple[int, int]]] = []
        for port in failure.transmitters + self._dropouts:
            hurt.append((port, True, (port.counters.tec, port.counters.rec)))
            if failure.error is BusError.ACK_ERROR:
                port.counters.acknowledge_error()
            else:
                port.counters.transmit_error()
        for port in failure.first + failure.others:
            hurt.append((port, False, (port.counters.tec, port.counters.rec)))
            port.counters.receive_error()
            if failure.outlasted and port in failure.first:
                port.counters.receive_error_first()
        messages = []
        for port, is_sender, old in hurt:
            port.statistics.errors += 1
            if old != (port.counters.tec, port.counters.rec):
                error = failure.error if is_sender or port in failure.first else None
                seen = error or BusError.BIT_STUFFING_ERROR
                message = bus_error_message(seen, port.counters, is_sender=is_sender)
                messages.append((port, *message))
        return messages

    def put_back(self, *, unanswered: bool) -> None:
        """Return the frames of a destroyed attempt to the head of their queues."""
        bus = self._bus
        popped = self._popped or tuple((port, bus._offer) for port in bus._senders)
        self._popped = self._dropouts = self._deaf = ()
        bus._senders = ()
        bus._failure = None
        for port, offer in popped:
            if port._closing and unanswered:
                port.detach()
            else:
                bus._enqueue(port, offer, first=True)

    def _suspend(self, port: Port) -> None:
        if port.counters.passive:
            port._ready_ns = self._bus._free_ns + SUSPEND_BITS * self._bus.bit_ns

    # Counters and messages

    def states(self) -> dict[str, ErrorState]:
        """Return the present state of every node."""
        return {port.name: port.counters.state for port in self._bus._ports.values()}

    def changes(
        self,
        before: dict[str, ErrorState],
        messages: list[tuple[Port, ErrorClass, bytearray]] | None = None,
    ) -> list[tuple[Port, ErrorClass, bytearray]]:
        """Follow changed states: bus-off, and a message each, merged into one already due."""
        changed = [
            port
            for port in tuple(self._bus._ports.values())
            if before.get(port.name, port.counters.state) != port.counters.state
        ]
        due = [] if messages is None else messages
        added = []
        for port in changed:
            classes, data = state_message(port.counters)
            known = next((index for index, entry in enumerate(due) if entry[0] is port), None)
            if known is None:
                added.append((port, classes, data))
            else:
                due[known][2][1] |= data[1]
                due[known] = (port, due[known][1] | classes, due[known][2])
            if port.counters.bus_off:
                self._bus._recovery.leave(port)
        if any(port.counters.bus_off for port in changed):
            self._bus._rewire()
        self._bus._reconsider()
        return added

    def deliver(self, messages: list[tuple[Port, ErrorClass, bytearray]]) -> None:
        """Hand error messages to those who want them; last of all, for they may send."""
        now_ns = self._bus.now_ns
        for port, classes, data in messages:
            if port._errors and port.attached:
                port._receive(Frame(ERROR_FLAG | classes, bytes(data), now_ns))

    def observe(self, error: BusError) -> None:
        """Show an error on the wire to the taps."""
        if self._bus._taps:
            classes, data = bus_error_message(error, ErrorCounters(), is_sender=False)
            arbitration_id = ERROR_FLAG | (classes & ~ErrorClass.CNT)
            frame = Frame(arbitration_id, bytes(data), self._bus.now_ns)
            for observe in self._bus._observers(arbitration_id):
                observe(frame)

    def integrate(self) -> None:
        """Let nodes which came during a frame take part from the next one on."""
        joining = [port for port in self._bus._ports.values() if port._joining]
        for port in joining:
            port._joining = False
        if joining:
            self._bus._rewire()
