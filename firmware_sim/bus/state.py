"""The state of a bus and of each of its ports: one value, on which all parts of the bus work.

The parts import this file and it imports none of them; it holds their shared state.
"""

from __future__ import annotations

import enum
import heapq
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from firmware_sim.bus.errors import BusError, ErrorClass, ErrorCounters
from firmware_sim.bus.fd_bits import FrameLength
from firmware_sim.bus.frame import CLASSIC_MAX, ERROR_FLAG, Filter, Frame, check_frame
from firmware_sim.bus.statistics import BusStatistics, IdStatistics, LoadMeter, PortStatistics

Receive: TypeAlias = Callable[[Frame], None]
"""Called with each accepted frame when it is complete."""

Offer: TypeAlias = tuple[int, int, bytes]
"""A frame to send: arbitration key, id with flags, data."""

NEVER_NS = 1 << 62
"""A time that does not come (146 years)."""


class FdSupport(enum.Enum):
    """Behaviour of a controller towards frames of CAN FD, in the terms of ISO 11898-1:2015.

    INTOLERANT: a classic controller destroys them with error frames, for all. TOLERANT: it ignores
    them. ENABLED: it sends, receives and acknowledges them.
    """

    INTOLERANT = "intolerant"
    TOLERANT = "tolerant"
    ENABLED = "enabled"


class Route(NamedTuple):
    """Route of the frames of one sender and one id; made once, discarded when the bus changes."""

    receivers: tuple[Receive, ...]
    ports: tuple[PortState, ...]
    statistics: IdStatistics


class Tap(NamedTuple):
    """Observer and the ids that it sees; None: all, and errors."""

    observe: Receive
    ids: frozenset[int] | None


class Message(NamedTuple):
    """Error message for a port."""

    port: PortState
    classes: ErrorClass
    data: bytearray


class Failure(NamedTuple):
    """How a frame will be destroyed, decided at its start.

    Attributes
    ----------
    error
        The error that its first observer sees.
    transmitters
        Nodes which send and see their frame destroyed.
    first
        Receivers which see it first.
    others
        Receivers which see the first ones' error flag.
    flag_bits
        Length of the superposed error flags.
    outlasted
        Whether another's active flag continues after those of `first` (rule b).
    """

    error: BusError
    transmitters: tuple[PortState, ...]
    first: tuple[PortState, ...]
    others: tuple[PortState, ...]
    flag_bits: int
    outlasted: bool = False


@dataclass(slots=True, eq=False, kw_only=True)
class PortState:
    """State of a node's controller and of its driver.

    Attributes
    ----------
    name, receive, errors, on_sent, queue_limit, listen_only, fd
        As given to `Bus.attach`.
    filters
        Acceptance filters; None: all frames pass.
    restart_ns
        Pause between bus-off and recovery (ns); None: it needs a restart by hand.
    counters, statistics
        Error counters and state of the controller, and counters since the attachment.
    queue
        Frames that wait.
    routes, sent_ids
        Routes of its frames by id, and ids completed so far.
    ready_ns
        Time from which it may start a frame.
    recovery, recovery_ns
        Sequences of recessive bits left of a recovery, and its start (ns).
    babbles
        Frames that it sends again and again without a pause.
    acknowledges, muted, cut, unanswered
        States set by faults of nodes.
    joining
        Whether it joined during a frame, which it does not receive.
    closing, detached
        Whether it leaves once its queue is empty, and whether it has left.
    alone
        Whether it tries to send on a cut wire.
    heard
        Whether any node acknowledges its frames.
    direct
        Whether its frames may go into the queue without further checks.
    """

    name: str
    receive: Receive
    filters: tuple[Filter, ...] | None
    errors: bool
    on_sent: Receive | None
    queue_limit: int
    restart_ns: int | None
    listen_only: bool
    fd: FdSupport
    joining: bool
    counters: ErrorCounters = field(default_factory=ErrorCounters)
    statistics: PortStatistics = field(default_factory=PortStatistics)
    queue: deque[Offer] = field(default_factory=deque)
    routes: dict[int, Route] = field(default_factory=dict)
    sent_ids: set[int] = field(default_factory=set)
    ready_ns: int = 0
    recovery: int = 0
    recovery_ns: int = 0
    babbles: tuple[Offer, ...] = ()
    acknowledges: bool = True
    muted: bool = False
    cut: bool = False
    unanswered: bool = False
    closing: bool = False
    detached: bool = False
    alone: bool = False
    heard: bool = False
    direct: bool = False

    @property
    def on_bus(self) -> bool:
        """Whether the node's controller takes part in the traffic."""
        return not (self.cut or self.detached or self.counters.bus_off)

    @property
    def listens(self) -> bool:
        """Whether frames reach the node's program."""
        return self.on_bus and not (self.joining or self.closing)

    @property
    def answers(self) -> bool:
        """Whether the controller acknowledges frames of others."""
        return self.listens and self.acknowledges and not self.listen_only

    def accepts(self, arbitration_id: int) -> bool:
        """Return whether frames of this id (with flags) pass the acceptance filters."""
        if arbitration_id > CLASSIC_MAX and self.fd is not FdSupport.ENABLED:
            return False
        filters = self.filters
        return filters is None or any(entry.passes(arbitration_id) for entry in filters)

    def ignores(self, arbitration_id: int) -> bool:
        """Return whether the controller waits for the end of frames of this id (with flags)."""
        if arbitration_id <= CLASSIC_MAX or self.fd is FdSupport.ENABLED:
            return False
        return self.fd is FdSupport.TOLERANT or self.listen_only

    def discard_queue(self) -> None:
        """Discard waiting frames."""
        self.statistics.discarded += len(self.queue)
        self.queue.clear()


@dataclass(slots=True, eq=False, kw_only=True)
class BusState:
    """State of the wire, and the ports on it.

    Attributes
    ----------
    bit_ns, data_bit_ns, now_ns
        Length of a bit, length of a bit in the data phase of CAN FD (0: classic bus), and present
        time (ns).
    until_ns
        Time up to which nothing is sent from outside (ns).
    meter, statistics
        Load, and counters of the bus.
    ports
        Ports by name, in the order of their attachment.
    offers
        Ports on the bus whose queue is not empty.
    taps
        Observers.
    senders
        Present senders: several if they send the same frame.
    offer, bits
        The frame on the wire and its length (bits).
    failure
        How it will be destroyed; None: it is completed.
    start_ns, done_ns
        Start and end of the frame (ns).
    free_ns
        Time from which the wire is free (ns).
    slow
        Whether an attempt needs a check of each port.
    fd_slow
        Whether an attempt with a frame of CAN FD does, because some controllers refuse such frames.
    hopeless
        Whether the last attempt was a lone error-passive node's: further ones fail, too, until
        another node joins or sends.
    dominant
        Number of causes that hold the wire dominant.
    watches_sending, watches_wire
        Whether faults look at frames before they are queued, and on the wire.
    babbling
        Whether a fault lets some node babble.
    cut_off
        Called with a port on a cut wire when it has something to send.
    timers, timer_ns, timer_number
        Heap of events, time of the first (ns), and number of events so far.
    """

    bit_ns: int
    data_bit_ns: int
    now_ns: int
    until_ns: int
    start_ns: int
    free_ns: int
    meter: LoadMeter
    statistics: BusStatistics = field(default_factory=BusStatistics)
    ports: dict[str, PortState] = field(default_factory=dict)
    offers: list[PortState] = field(default_factory=list)
    taps: list[Tap] = field(default_factory=list)
    senders: tuple[PortState, ...] = ()
    offer: Offer = (0, 0, b"")
    bits: int = 0
    failure: Failure | None = None
    done_ns: int = 0
    slow: bool = False
    fd_slow: bool = False
    hopeless: bool = False
    dominant: int = 0
    watches_sending: bool = False
    watches_wire: bool = False
    babbling: bool = False
    cut_off: Callable[[PortState], None] = field(init=False)
    timers: list[tuple[int, int, Callable[[], None]]] = field(default_factory=list)
    timer_ns: int = NEVER_NS
    timer_number: int = 0

    def check(self, arbitration_id: int, length: int) -> None:
        """Raise ValueError unless the bus carries frames of this id (with flags) and length."""
        check_frame(arbitration_id, length)
        if arbitration_id > CLASSIC_MAX and not self.data_bit_ns:
            raise ValueError(f"frame {arbitration_id:X}: the bus has no data bit rate for CAN FD")

    def duration_ns(self, length: FrameLength, bit: int) -> int:
        """Return the time from the start of a frame to the end of its first `bit` bits (ns)."""
        fast = min(max(bit - length.data_phase, 0), length.fast_bits)
        return bit * self.bit_ns - fast * (self.bit_ns - self.data_bit_ns)

    def schedule(self, due_ns: int, action: Callable[[], None]) -> None:
        """Have `action` called when time reaches `due_ns` (at once if it has passed)."""
        self.timer_number += 1
        heapq.heappush(self.timers, (max(due_ns, self.now_ns), self.timer_number, action))
        self.timer_ns = self.timers[0][0]

    def rewire(self) -> None:
        """Recompute everything that depends on the nodes on the bus and their states."""
        self.hopeless = False
        ports = self.ports.values()
        answering = [port for port in ports if port.answers]
        for port in ports:
            port.routes.clear()
            port.heard = not port.unanswered and any(other is not port for other in answering)
            port.direct = (
                port.on_bus
                and not (port.muted or port.closing or port.listen_only)
                and not self.watches_sending
            )
        self.fd_slow = any(port.fd is not FdSupport.ENABLED for port in ports)
        self.offers[:] = [port for port in ports if port.queue and port.on_bus]
        self.reconsider()

    def reconsider(self) -> None:
        """Decide whether frames may take the short path."""
        now_ns = self.now_ns
        self.slow = (
            self.watches_wire
            or self.babbling
            or any(
                port.counters.tec
                or port.counters.rec
                or port.joining
                or port.closing
                or port.ready_ns > now_ns
                for port in self.ports.values()
            )
        )

    def enqueue(self, port: PortState, offer: Offer, *, first: bool = False) -> None:
        """Put a frame into a port's queue, whatever its limit, and offer it to the bus."""
        if port.muted or port.detached or port.counters.bus_off:
            port.statistics.discarded += 1
            return
        if first:
            port.queue.appendleft(offer)
        else:
            port.queue.append(offer)
        if len(port.queue) == 1:
            if port.cut:
                self.cut_off(port)
            else:
                self.offers.append(port)

    def babble(self, port: PortState, offer: Offer) -> None:
        """Put a frame at the head of a port's queue, unless it is there already."""
        if not (port.queue and port.queue[0] == offer):
            self.enqueue(port, offer, first=True)

    def detach(self, port: PortState) -> None:
        """Take a port off the bus; its queue is discarded, a frame being sent is completed."""
        port.detached = True
        port.direct = False
        port.babbles = ()
        port.discard_queue()
        if self.ports.get(port.name) is port:
            del self.ports[port.name]
        self.rewire()

    def detach_if_done(self, port: PortState) -> None:
        """Take a closing port off the bus once all its frames are out or cannot get out."""
        done = not port.queue and port not in self.senders
        if done or not port.on_bus:
            self.detach(port)

    def observers(self, arbitration_id: int) -> tuple[Receive, ...]:
        """Return the listeners that see frames or error messages of an id without being nodes."""
        return tuple(
            tap.observe for tap in self.taps if tap.ids is None or arbitration_id in tap.ids
        )

    def deliver(self, messages: list[Message]) -> None:
        """Hand error messages to their subscribers; called last, because subscribers may send."""
        now_ns = self.now_ns
        for port, classes, data in messages:
            if port.errors and not port.detached:
                port.receive(Frame(ERROR_FLAG | classes, bytes(data), now_ns))
