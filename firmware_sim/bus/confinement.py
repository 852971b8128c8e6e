"""Irregular events on the wire: collisions, error frames, bus-off, recovery.

Source: ISO 11898-1:2015, clause 10.11 (error signalling) and 12.1.4 (fault confinement). An error
flag takes 6 bits, with the others' flags up to 12, the error delimiter 8; a frame is destroyed
for all nodes or, when only error-passive nodes object, for these alone.
"""

from __future__ import annotations

from firmware_sim.bus.bits import ACK_SLOT_TO_END_BITS, INTERMISSION_BITS
from firmware_sim.bus.errors import (
    BusError,
    ErrorClass,
    ErrorCounters,
    ErrorState,
    bus_error_message,
    state_message,
)
from firmware_sim.bus.fd_bits import FrameLength, frame_bit_sequence, frame_length
from firmware_sim.bus.frame import CLASSIC_MAX, ERROR_FLAG, ERROR_STATE_FLAG, Frame
from firmware_sim.bus.frame_faults import FrameFaults, Strike
from firmware_sim.bus.recovery import BusOffRecovery
from firmware_sim.bus.state import (
    BusState,
    Failure,
    FdSupport,
    Message,
    Offer,
    PortState,
    Route,
)

FLAG_BITS = 6
DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""Bits after the intermission that an error-passive transmitter waits (suspend transmission)."""
STUFF_ERROR_BITS = 6
"""Bits after BRS at which a classic controller detects an error. Real ones do so at some bit of the
data phase, which they sample at the nominal bit rate."""


class Confinement:
    """Runs the attempts that `Bus` leaves to it, and keeps the error counters.

    Parameters
    ----------
    bus
        The bus's state.
    faults
        Faults of its frames.
    recovery
        Recovery of its nodes.
    """

    def __init__(self, bus: BusState, faults: FrameFaults, recovery: BusOffRecovery) -> None:
        self._bus = bus
        self._faults = faults
        self._recovery = recovery
        self._popped: tuple[tuple[PortState, Offer], ...] = ()
        self._dropouts: tuple[PortState, ...] = ()
        self._deaf: tuple[PortState, ...] = ()
        self._length = FrameLength(0, 0, 0)

    # One attempt to send

    def begin(self, start_ns: int) -> None:
        """Start the most urgent frame and decide how it will end."""
        bus = self._bus
        self._recovery.count_recessive(start_ns)
        offering = [port for port in bus.offers if port.ready_ns <= start_ns]
        key = min(port.queue[0][0] for port in offering)
        contenders = tuple(port for port in offering if port.queue[0][0] == key)
        for port in offering:
            if port not in contenders:
                port.statistics.arbitration_lost += 1
        survivors, collision_bit = self._collide(contenders)
        self._popped = tuple((port, port.queue.popleft()) for port in survivors)
        bus.offers[:] = [port for port in bus.offers if port.queue]
        bus.senders = survivors
        bus.offer = _as_sent(survivors[0], self._popped[0][1])
        _, arbitration_id, data = bus.offer
        self._length = frame_length(arbitration_id, data)
        bus.bits = self._length.bits
        end_bit = self._decide(survivors, collision_bit)
        bus.done_ns = start_ns + bus.duration_ns(self._length, end_bit)

    def _collide(
        self, contenders: tuple[PortState, ...]
    ) -> tuple[tuple[PortState, ...], int | None]:
        """Resolve several nodes sending one id.

        Returns those still sending, and the bit at which an error flag destroys all; None where
        their frames are equal, or where only error-passive nodes had to give way.
        """
        self._dropouts = ()
        frames = {port: _as_sent(port, port.queue[0])[1:] for port in contenders}
        if len(set(frames.values())) == 1:
            return contenders, None
        streams = {port: frame_bit_sequence(*frame) for port, frame in frames.items()}
        while True:
            columns = enumerate(zip(*(streams[port] for port in contenders), strict=False))
            bit = next((index for index, bits in columns if len(set(bits)) > 1), None)
            if bit is None:  # remote requests of one length: their data is not sent
                return contenders, None
            losers = tuple(port for port in contenders if streams[port][bit] == 1)
            if any(not port.counters.passive for port in losers):
                return contenders, bit + 1
            self._dropouts += losers
            contenders = tuple(port for port in contenders if port not in losers)

    def _decide(self, senders: tuple[PortState, ...], collision_bit: int | None) -> int:
        """Set the bus's failure, if any; return the bit at which the attempt is over."""
        bus = self._bus
        busy = senders + self._dropouts
        receivers = tuple(
            port
            for port in bus.ports.values()
            if port.on_bus
            and not port.joining
            and port not in busy
            and not port.ignores(bus.offer[1])
        )
        self._deaf = ()
        if collision_bit is not None:
            bus.failure = Failure(BusError.BIT_ERROR, senders, (), receivers, 2 * FLAG_BITS)
            return collision_bit
        if bus.fd_slow and bus.offer[1] > CLASSIC_MAX:
            bus.failure = self._object(senders, receivers)
            if bus.failure is not None:
                return self._length.data_phase + STUFF_ERROR_BITS
        strike = self._faults.strike(senders[0], bus.offer, bus.bits)
        if strike is not None:
            bus.failure = self._strike(strike, senders, receivers)
            if bus.failure is not None:
                return strike.bit
        if self._answered(senders, receivers):
            return bus.bits
        # An error-passive sender's flag is recessive, so no other node sees it.
        seen_by = () if senders[0].counters.passive else receivers
        active = any(not port.counters.passive for port in seen_by)
        flag_bits = 2 * FLAG_BITS if active else FLAG_BITS
        bus.failure = Failure(BusError.ACK_ERROR, senders, (), seen_by, flag_bits)
        return bus.bits - ACK_SLOT_TO_END_BITS

    def _answered(self, senders: tuple[PortState, ...], receivers: tuple[PortState, ...]) -> bool:
        """Return whether one of the receivers acknowledges a frame."""
        answering = any(port.answers and port not in self._deaf for port in receivers)
        return answering and not any(port.unanswered for port in senders)

    def _object(
        self, senders: tuple[PortState, ...], receivers: tuple[PortState, ...]
    ) -> Failure | None:
        """Return how classic controllers destroy a frame of CAN FD; None: they cannot."""
        classic = tuple(port for port in receivers if port.fd is FdSupport.INTOLERANT)
        first = tuple(port for port in classic if not port.counters.passive)
        if not first:
            self._deaf = classic
            return None
        others = tuple(port for port in receivers if port not in first)
        outlasted = any(not port.counters.passive for port in senders + others)
        return Failure(
            BusError.BIT_STUFFING_ERROR, senders, first, others, FLAG_BITS + outlasted, outlasted
        )

    def _strike(
        self, strike: Strike, senders: tuple[PortState, ...], receivers: tuple[PortState, ...]
    ) -> Failure | None:
        """Turn an injected error into its consequences; None if the frame survives it."""
        if strike.error is BusError.BIT_ERROR:
            return Failure(strike.error, senders, (), receivers, 2 * FLAG_BITS)
        first = tuple(port for port in receivers if strike.receiver in (None, port.name))
        if not first:
            return None
        if strike.receiver is not None and first[0].counters.passive:
            self._deaf = first  # its passive error flag disturbs no other node
            return None
        others = tuple(port for port in receivers if port not in first)
        # Flags of a CRC error wait for the acknowledge delimiter. Where nobody has acknowledged,
        # that of the transmitter is there before them, and ends before them.
        early = strike.error is BusError.CRC_ERROR and not self._answered(senders, others)
        outlasted = not early and any(not port.counters.passive for port in senders + others)
        flag_bits = FLAG_BITS + outlasted
        return Failure(strike.error, senders, first, others, flag_bits, outlasted)

    def complete(self, senders: tuple[PortState, ...], route: Route, frame: Frame) -> None:
        """Count and deliver a completed frame."""
        bus = self._bus
        before = self.states()
        deaf = self._deaf + self._dropouts + senders
        self._count_success(senders, deaf)
        self._popped = self._dropouts = self._deaf = ()
        self.integrate()
        messages = self.changes(before)
        lost = self._faults.losses(senders[0], frame)
        for observe in bus.observers(frame.arbitration_id):
            observe(frame)
        for port in route.ports:
            if port not in deaf and not lost & {None, port.name}:
                port.receive(frame)
        bus.deliver(messages)
        for port in senders:
            if port.on_sent is not None:
                port.on_sent(frame)
            for offer in port.babbles:
                bus.babble(port, offer)
            if port.closing and not port.detached:
                bus.detach_if_done(port)

    def _count_success(self, senders: tuple[PortState, ...], deaf: tuple[PortState, ...]) -> None:
        """Apply the counting rules to a completed frame."""
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
        for port in self._bus.ports.values():
            if (
                port.on_bus
                and not port.joining
                and port not in deaf
                and not port.ignores(self._bus.offer[1])
            ):
                port.counters.received()

    def fail(self) -> None:
        """Destroy the frame on the wire: error flags, counters, retransmission."""
        bus = self._bus
        failure = bus.failure
        if failure is None:
            raise RuntimeError("no failure has been decided")
        before = self.states()
        messages = self.count(failure)
        _, arbitration_id, _ = bus.offer
        bus.statistics.count_error(failure.error)
        bus.statistics.of(arbitration_id).errors += 1
        dead_bits = failure.flag_bits + DELIMITER_BITS + INTERMISSION_BITS
        bus.free_ns = bus.now_ns + dead_bits * bus.bit_ns
        bus.meter.busy_ns += bus.free_ns - bus.start_ns
        for port in failure.transmitters:
            self._suspend(port)
        self.put_back(unanswered=failure.error is BusError.ACK_ERROR)
        self.integrate()
        changed = bool(messages)
        messages += self.changes(before, messages)
        alone = len(bus.offers) == 1 and not bus.offers[0].heard
        alone = alone and not (bus.watches_wire or bus.babbling)
        bus.hopeless = not changed and alone and failure.error is BusError.ACK_ERROR
        if bus.hopeless:
            self._skip(failure.error, dead_bits)
        if changed:
            self.observe(failure.error)
        bus.deliver(messages)

    def _skip(self, error: BusError, dead_bits: int) -> None:
        """Count the coming attempts of a lone node at once, as far as time will pass now."""
        bus = self._bus
        port = bus.offers[0]
        attempt_ns = bus.duration_ns(self._length, bus.bits - ACK_SLOT_TO_END_BITS)
        period_ns = attempt_ns + (dead_bits + SUSPEND_BITS) * bus.bit_ns
        until_ns = min(bus.until_ns, bus.timer_ns)
        first_end_ns = port.ready_ns + attempt_ns
        if _as_sent(port, port.queue[0]) != bus.offer or until_ns < first_end_ns:
            return
        count = 1 + (until_ns - first_end_ns) // period_ns
        bus.free_ns += count * period_ns
        port.ready_ns += count * period_ns
        port.statistics.errors += count
        bus.statistics.count_error(error, count)
        bus.statistics.of(bus.offer[1]).errors += count
        bus.meter.busy_ns += count * (attempt_ns + dead_bits * bus.bit_ns)

    def count(self, failure: Failure) -> list[Message]:
        """Apply the counting rules; return the messages for those whose counters changed."""
        hurt: list[tuple[PortState, bool, tuple[int, int]]] = []
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
                messages.append(Message(port, *message))
        return messages

    def put_back(self, *, unanswered: bool) -> None:
        """Return the frames of a destroyed attempt to the head of their queues."""
        bus = self._bus
        popped = self._popped or tuple((port, bus.offer) for port in bus.senders)
        self._popped = self._dropouts = self._deaf = ()
        bus.senders = ()
        bus.failure = None
        for port, offer in popped:
            if port.closing and unanswered:
                bus.detach(port)
            else:
                bus.enqueue(port, offer, first=True)

    def _suspend(self, port: PortState) -> None:
        if port.counters.passive:
            port.ready_ns = self._bus.free_ns + SUSPEND_BITS * self._bus.bit_ns

    # Counters and messages

    def states(self) -> dict[str, ErrorState]:
        """Return the present state of every node."""
        return {port.name: port.counters.state for port in self._bus.ports.values()}

    def changes(
        self,
        before: dict[str, ErrorState],
        messages: list[Message] | None = None,
    ) -> list[Message]:
        """Act on changed states: bus-off, and one message each, merged into one already due."""
        changed = [
            port
            for port in tuple(self._bus.ports.values())
            if before.get(port.name, port.counters.state) != port.counters.state
        ]
        due = [] if messages is None else messages
        added = []
        for port in changed:
            classes, data = state_message(port.counters)
            known = next((index for index, entry in enumerate(due) if entry[0] is port), None)
            if known is None:
                added.append(Message(port, classes, data))
            else:
                _, seen, told = due[known]
                told[1] |= data[1]
                told[6:] = data[6:]
                due[known] = Message(port, (seen & ~ErrorClass.CNT) | classes, told)
            if port.counters.bus_off:
                self._recovery.leave(port)
        if any(port.counters.bus_off for port in changed):
            self._bus.rewire()
        self._bus.reconsider()
        return added

    def observe(self, error: BusError) -> None:
        """Show an error on the wire to the taps."""
        if self._bus.taps:
            classes, data = bus_error_message(error, ErrorCounters(), is_sender=False)
            arbitration_id = ERROR_FLAG | (classes & ~ErrorClass.CNT)
            frame = Frame(arbitration_id, bytes(data), self._bus.now_ns)
            for observe in self._bus.observers(arbitration_id):
                observe(frame)

    def integrate(self) -> None:
        """Let nodes that joined during a frame take part from the next one on."""
        joining = [port for port in self._bus.ports.values() if port.joining]
        for port in joining:
            port.joining = False
        if joining:
            self._bus.rewire()


def _as_sent(port: PortState, offer: Offer) -> Offer:
    """Return a frame as its controller sends it: an error-passive one says so in CAN FD (ESI)."""
    key, arbitration_id, data = offer
    if arbitration_id > CLASSIC_MAX and port.counters.passive:
        return key, arbitration_id | ERROR_STATE_FLAG, data
    return offer
